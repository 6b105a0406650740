#version 430 core
// Asks about points of faces: which pass the filters (Sec. 2.1.1: CropFOV, CropBack, CropNorm,
// CropNear), and in which cell each lies. One invocation a face of the clusters listed.
// in:  listed       clusters + 1 that may have a face to count; faces where PARTS is defined
//      face_centres two texels a face: centre of mass and longest edge, unit normal; float bits
// out: heads        record + 1 of the point that came last to a cell, 0: none
//      records      (column, row, 1) * depth of a point as float bits, and the record + 1 of the
//                   point that came before it to the same cell, with LARGE where it is of a face
//                   that may be large
//      tiles        depth bits of the farthest point, by tile
//      free         record + 1 of the face's centre where a point passes the filters, else 0; with
//                   LARGE where a face may be large and have a point that passes them
// PARTS is defined where several points of a face are asked about, the centres of mass of its
// PARTS x PARTS congruent parts: an invocation a point, and a list of faces + 1 in place of clusters.
// Else it is each face's own centre of mass.
// LENS is defined where the sensor's image is not the window, or its range not depth; WINDOWS where a
// view has several, which all have their say about the same records. PARTNER is defined for a second
// viewpoint: asked are the points that the first one sees, and those that pass are looked up again;
// faces that show it no point are marked as large no more.
layout(local_size_x = 64) in;
#include "view.glsl"
#include "filters.glsl"
#ifdef LENS
#include "lens.glsl"
#endif
#ifdef PARTS
#include "corners.glsl"
#endif
layout(binding = 1) uniform usampler2D face_centres;
layout(rgba32ui, binding = 0) uniform writeonly uimage2D records;
layout(r32ui, binding = 1) uniform uimage2D heads;
layout(r32ui, binding = 2) uniform uimage2D tiles;
layout(std430, binding = 0) readonly buffer Listed { uint listed[]; };
layout(std430, binding = 2) buffer Free { uint free[]; };

const float SLACK = 1e-5;       // of what decides on large faces, which float32 may round

// Put a point that is asked about into the cell where it lies, place being where in the grid.
void look_up(vec3 place, uint record, uint mark) {
    ivec2 cell = min(ivec2(place.xy / place.z + 0.5 * vec2(size)), size - 1);
    imageAtomicMax(tiles, cell / TILE + ivec2(0, first_tile_row), floatBitsToUint(place.z));
    uint before = imageAtomicExchange(heads, cell + ivec2(0, first_row), record + 1u);
    imageStore(records, record_at(record), uvec4(floatBitsToUint(place), before | mark));
}

// Ask about a point (relative to the origin) of a face: `own` is the record of its centre, and no
// point of the face is farther from the point than its edge, of faces that may be large.
void ask(bool wanted, vec3 point, vec3 normal, uint record, uint own, float edge) {
    vec3 place = in_grid(point);
    vec2 at = place.xy / place.z + 0.5 * vec2(size);
    vec3 back = eye.xyz - point;
    float towards = dot(normal, back);
    bool faces = crop_back(towards) && crop_norm_by_axis(dot(normal, backwards.xyz), backwards.w);
    float far_off = place.z;
    bool in_window = crop_fov(at, vec2(size), place.z, place.z);
#ifdef LENS
    vec3 direction = -vec3(dot(back, right.xyz), dot(back, up.xyz), -dot(back, backwards.xyz));
    far_off = measured(direction);
    in_window = in_window && place.z > 0.0;
#endif
    bool passes = crop_near(far_off, working_range.x) && crop_far(far_off, working_range.y)
        && faces && crop_norm_by_ray(towards, dot(back, back), min_ray_cos);
#if !(defined(PARTNER) && defined(WINDOWS))
    passes = passes && in_window;
#endif
#ifdef LENS
    if (passes) passes = in_image(direction);
#endif
    // whether another point of the face may pass; with WINDOWS in whatever window, for all of them
    // must say the same
    bool in_range = abs(far_off - clamp(far_off, working_range.x, working_range.y)) <= edge;
    bool may_pass = faces && in_range
        && towards >= (1.0 - SLACK) * min_ray_cos * (length(back) - edge);
    float nearest = length(back) - edge;
#ifndef WINDOWS
    mat3 to_grid = transpose(mat3(world_to_grid));
    vec2 scale = vec2(length(to_grid[0]), length(to_grid[1])), half_size = 0.5 * vec2(size);
    vec2 reach = half_size * place.z + edge * (scale + half_size);
    may_pass = may_pass && all(lessThanEqual(abs(place.xy), (1.0 + SLACK) * reach));
    nearest = place.z - edge;
#endif
#ifdef PARTNER
    uint known = free[record];
    if (!wanted || known == 0u) return;
    uint mark = may_pass ? known & LARGE : 0u;
    bool stays = (known & ~LARGE) != 0u && passes;
#ifdef WINDOWS
    // a point on the seam of windows is looked up in one of them: it has one record
    atomicAnd(free[record], stays ? ~LARGE | mark : mark);
    if (stays && in_window && (atomicOr(free[record], LOOKED_UP) & LOOKED_UP) == 0u)
        look_up(place, record, mark);
#else
    free[record] = stays ? known & ~LARGE | mark : mark;
    if (stays) look_up(place, record, mark);
#endif
#else
    bool is_large = edge * span >= max(nearest, near) && may_pass;
    uint mark = is_large ? LARGE : 0u;
    if (wanted && (passes || is_large)) {
        uint found = (passes ? own + 1u : 0u) | mark;
#ifdef WINDOWS
        // a point on the seam of windows is looked up in one of them: it has one record
        passes = (atomicOr(free[record], found) & ~LARGE) == 0u && passes;
#else
        free[record] = found;
#endif
    }
    if (wanted && passes) look_up(place, record, mark);
#endif
}

void main() {
#ifdef PARTS
    const uint points = uint(PARTS * PARTS);
    uint i = invocation(), k = i % points, entry = listed[first_listed + i / points];
    bool is_listed = entry != 0u;
    uint face = max(entry, 1u) - 1u;
    vec3[3] corners = corners_of(face);
    // parts (u, v) of a parallelogram; the half beyond the face folds back into it
    vec2 uv = vec2(k % uint(PARTS), k / uint(PARTS));
    bool is_folded = uv.x + uv.y > float(PARTS) - 0.5;
    uv = (is_folded ? float(PARTS - 1) - uv + 2.0 / 3.0 : uv + 1.0 / 3.0) / float(PARTS);
    vec3 point = corners[0] + uv.x * (corners[1] - corners[0]) + uv.y * (corners[2] - corners[0]);
    uint record = first_extra + i;
#else
    uint i = invocation(), cluster = listed[first_listed + (i >> size_log2)];
    uint face = ((max(cluster, 1u) - 1u) << size_log2) + (i & ((1u << size_log2) - 1u));
#endif
    ivec2 at = ivec2(2u * (face % FACES_A_LINE), face / FACES_A_LINE);
    vec3 normal = uintBitsToFloat(texelFetch(face_centres, at + ivec2(1, 0), 0).xyz);
    uint own = first_record + face;
#ifdef PARTS
    ask(is_listed, point, normal, record, own, 0.0);
#else
    vec4 centre = uintBitsToFloat(texelFetch(face_centres, at, 0));
    ask(cluster != 0u, centre.xyz, normal, own, own, centre.w);
#endif
}
