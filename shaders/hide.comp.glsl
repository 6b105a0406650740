#version 430 core
// Finds the points that faces hide: an irregular Z-buffer (Aila and Laine 2004; Johnson et al.
// 2005). Points are looked up by cell, but each is tested against the face itself, so that what is
// found does not depend on the cells. One invocation a face of the clusters listed; both sides hide.
// in:  listed       clusters + 1 that may hide a point, see keep.comp.glsl
//      heads, records  points by cell, see ask.comp.glsl
// out: free         0, or LARGE, where a point is hidden
//      listed, dispatches  faces that cover many cells, which are left to the second run
//      unfinished   1 where an invocation was cut short: llvmpipe leaves loops after 65,535 turns
// SPREAD is defined in the second run: there a work group has to do with one such face, and each
// invocation with some of its rows.
// What is decided is decided up to rounding: a face hides a point where it is nearer than the point
// by more than float32 can tell, and it reaches to its edges and so much beyond. So faces that lie
// in one plane do not hide each other, and nothing shows between two faces that share an edge.
layout(local_size_x = 64) in;
#include "view.glsl"
#include "corners.glsl"
layout(binding = 2) uniform usampler2D records;
layout(binding = 3) uniform usampler2D heads;
layout(std430, binding = 0) buffer Listed { uint listed[]; };
layout(std430, binding = 1) buffer Dispatches { uint dispatches[]; };
layout(std430, binding = 3) buffer Unfinished { uint unfinished; };
layout(std430, binding = 2) buffer Free { uint free[]; };

const float STEP = 1.2e-7;      // of float32, 2^-23
const float ROUNDING = 3.0 * STEP;
const float CELL = 1e-3;        // margin around cells; harmless: it only makes more of them visited
const float FAR = 1e9;          // beyond all cells
const int MANY = 4096;          // cells from which a face is left to the second run
const float FLAT = 1e-4;        // an edge that changes its row by less from column to column
const uint MOST_GROUPS = 65535u;    // in one direction, as every OpenGL takes them

void main() {
#ifdef SPREAD
    uint face = listed[first_spread + gl_WorkGroupID.x];
    const bool is_listed = true;
    int row = int(gl_LocalInvocationIndex);
    const int rows = int(gl_WorkGroupSize.x);
#else
    uint i = invocation(), cluster = listed[first_kept + (i >> size_log2)];
    uint face = ((max(cluster, 1u) - 1u) << size_log2) + (i & ((1u << size_log2) - 1u));
    bool is_listed = cluster != 0u;
    const int row = 0, rows = 1;
#endif
    vec3[3] corners = corners_of(face);
    vec3 a = in_grid(corners[0]), b = in_grid(corners[1]), c = in_grid(corners[2]);
    vec3 ab = b - a, bc = c - b, ca = a - c;
    // the plane n . x = d, turned so that the eye lies at n . x < d
    // by the two shorter edges, for the sake of slivers
    vec3 lengths = vec3(dot(ab, ab), dot(bc, bc), dot(ca, ca));
    float longest = max(lengths.x, max(lengths.y, lengths.z));
    vec3 u = lengths.x == longest ? bc : lengths.y == longest ? ca : ab;
    vec3 v = lengths.x == longest ? ca : lengths.y == longest ? ab : bc;
    vec3 n = cross(u, v);
    float d = dot(n, a);
    float side = sign(d);
    // planes through the eye and the edges: e . x >= 0 inside, one a component
    vec3 first = cross(a, ab) * side, second = cross(b, bc) * side, third = cross(c, ca) * side;
    vec3 ex = vec3(first.x, second.x, third.x);
    vec3 ey = vec3(first.y, second.y, third.y);
    vec3 ez = vec3(first.z, second.z, third.z);
    vec2 extent = vec2(size), middle = 0.5 * extent;
    ez += ROUNDING * (abs(ex) * middle.x + abs(ey) * middle.y + abs(ez));
    n *= side;
    d *= side;
    n.z -= ROUNDING * (abs(n.x) * middle.x + abs(n.y) * middle.y + abs(n.z));
    // of a sliver, the plane's direction is rounding: so much over the length of the face
    u = abs(u);
    v = abs(v);
    d += STEP * dot(u.yzx * v.zxy + u.zxy * v.yzx, u + v);
    // and where its corners are, of a face that reaches far beyond the image
    d += STEP * dot(abs(n), max(abs(a), max(abs(b), abs(c))));
    // and all coordinates, of a face far from the origin
    vec3 most = max(abs(corners[0]), max(abs(corners[1]), abs(corners[2]))) + abs(eye.xyz);
    mat3 turn = mat3(abs(world_to_grid[0].xyz), abs(world_to_grid[1].xyz), abs(world_to_grid[2].xyz));
    d += 2.0 * STEP * dot(abs(n), turn * most);

    // cells: of the box around the face, and row by row between its edges
    // The box also ends what rounding lets edges reach beyond a sharp tip.
    vec2 low = vec2(-FAR), high = vec2(FAR);
    if (min(a.z, min(b.z, c.z)) > near) {
        vec2 p = a.xy / a.z, q = b.xy / b.z, r = c.xy / c.z;
        low = min(p, min(q, r)) - ROUNDING * extent;
        high = max(p, max(q, r)) + ROUNDING * extent;
    }
    vec4 box = vec4(low, -high);
    low += middle;
    high += middle;
    bool is_outside = !is_listed || side == 0.0 || max(a.z, max(b.z, c.z)) <= near
        || any(lessThan(high, vec2(-CELL))) || any(greaterThan(low, extent + CELL));
    ivec2 from = ivec2(clamp(low - CELL, vec2(0.0), extent - 1.0));
    ivec2 to = ivec2(clamp(high + CELL, vec2(0.0), extent - 1.0));
#ifndef SPREAD
    ivec2 cells = to - from + 1;
    if (!is_outside && cells.x * cells.y > MANY) {
        uint place = atomicAdd(dispatches[4u * request + 7u], 1u);
        if (place < min(n_listed, MOST_GROUPS)) {
            atomicAdd(dispatches[4u * request + 4u], 1u);
            listed[first_spread + place] = face;
            is_outside = true;
        }
    }
#endif
    // an edge that runs nearly along the rows limits no columns
    vec3 flat_ex = FLAT * abs(ey);
    bvec3 on_left = greaterThan(ex, flat_ex), on_right = lessThan(ex, -flat_ex);
    bvec3 is_steep = greaterThan(abs(ex), flat_ex);
    vec3 over_ex = -1.0 / mix(vec3(1.0), ex, is_steep);
    vec3 slope = mix(vec3(0.0), ey * over_ex, is_steep);
    vec3 start = (ez - ex * middle.x - ey * middle.y) * over_ex;
    vec3 margin = CELL + ROUNDING * (abs(start) + abs(slope) * extent.y);
    vec3 left = mix(vec3(-FAR), start + min(slope, 0.0) - margin, on_left);
    vec3 right = mix(vec3(FAR), start + max(slope, 0.0) + margin, on_right);

    // One loop over rows, cells and points: a software driver leaves a loop when all invocations
    // side by side do, and nested loops would wait for each other.
    int x = 1, end = 0, y = is_outside ? to.y : from.y + row - rows;
    uint next = 0u;
    while (true) {
        if (next == 0u) {
            ++x;
            if (x > end) {
                y += rows;
                vec3 l = left + slope * float(y), r = right + slope * float(y);
                x = max(from.x, int(clamp(max(l.x, max(l.y, l.z)), 0.0, extent.x)));
                end = min(to.x, int(clamp(min(r.x, min(r.y, r.z)), -1.0, extent.x)));
            }
            if (y > to.y) break;
            if (x <= end) next = texelFetch(heads, ivec2(x, y + first_row), 0).r;
        }
        if (next != 0u) {
            uvec4 record = texelFetch(records, record_at(next - 1u), 0);
            vec3 point = uintBitsToFloat(record.xyz);
            vec3 inside = ex * point.x + ey * point.y + ez * point.z;
            float beyond = dot(n, point);
            bool hides = min(inside.x, min(inside.y, inside.z)) >= 0.0 && beyond > d
                && near * beyond < d * point.z
                && all(greaterThanEqual(vec4(point.xy, -point.xy), box * point.z));
            if (hides) free[next - 1u] = record.w & LARGE;
            next = record.w & ~LARGE;
        }
    }
    if (next != 0u || y <= to.y) unfinished = 1u;
}
