#version 430 core
// Small faces without a rasteriser: one invocation a face casts a ray through the middle of each
// pixel that the face may cover. What a draw spends on a triangle of a few pixels is mostly
// set-up, and this has none. The camera frame here is (right, up, depth along the optical axis)
// from the eye; rows of pixels count upwards.
//
// Without JUDGE each invocation casts a face of the chosen clusters:
// out: depth   the nearest distance along the axis a pixel, as bits: those of floats sort alike
// With JUDGE faces are judged against these depths, and where DRAWN is defined against a drawn depth
// buffer too: each invocation one by its pixels (COUNT_PIXELS), or all of a cluster by their
// centres (LOOK_AT_CENTRE); then nobody else writes its word, and no operation need be atomic.
// Where both are defined, a face is seen by either.
// out: seen    a word a cluster, one bit a face; 0 before
layout(local_size_x = 64) in;

// Tables, 4096 rows of four words a line; coordinates are the bits of floats.
layout(binding = 0) uniform usampler2D vertices;    // xyz: world frame relative to the origin
layout(binding = 1) uniform usampler2D corners;     // xyz: vertex numbers
layout(binding = 2) uniform usampler2D centroids;   // xyz: as vertices
layout(binding = 3) uniform usampler2D normals;     // xyz: unit
layout(binding = 4) uniform sampler2D drawn;        // OpenGL depth

layout(std430, binding = 0) readonly buffer Clusters { uint clusters[]; };
layout(std430, binding = 1) buffer Depth { uint depth[]; };
layout(std430, binding = 2) buffer Seen { uint seen[]; };

layout(std140, binding = 0) uniform View {
    mat4 world_to_camera;
    vec4 tangent_to_pixel;      // scale xy, offset zw
    vec2 working_range;         // minD, maxD as depth
    vec2 min_cos;               // of the incidence: by the ray, 0 for any; by the axis, -2 for any
    vec2 clip;                  // near and far plane of what was drawn
    float tolerance;            // share of its depth by which something nearer hides a centre
    float cull_backs;           // 1: backs hide nothing
    ivec2 size;                 // of the image, pixels
    int first_row;              // of this view in depth
    int min_pixels;             // in how many a face must show, at least 1
    uint first_cluster, n_clusters, n_small;   // in clusters; those with small faces come first
    uint size_log2;             // faces in one, at most 32
};

uvec4 row(usampler2D table, uint i) { return texelFetch(table, ivec2(i & 4095u, i >> 12), 0); }

// precise: both passes, and both faces at an edge, must get the same numbers.
vec3 in_camera(uvec4 bits) {
    precise vec4 place = world_to_camera * vec4(uintBitsToFloat(bits.xyz), 1.0);
    return place.xyz;
}

vec2 pixel_of(vec2 tangent) {
    precise vec2 pixel = tangent * tangent_to_pixel.xy + tangent_to_pixel.zw;
    return pixel;
}

vec3 ray_through(vec2 pixel) {
    return vec3((pixel - tangent_to_pixel.zw) / tangent_to_pixel.xy, 1.0);
}

float turn_of(vec2 a, vec2 b) {
    precise float turn = a.x * b.y - a.y * b.x;
    return turn;
}

// A face in the image, and the pixels that it may cover.
struct Triangle {
    vec2 a, b, c;
    vec3 nearness;   // 1 / depth, which is linear in the image
    float side;      // 1 where its front shows, -1 where its back does
    ivec2 from, to;
};

Triangle triangle_of(uint face) {
    uvec4 vertex = row(corners, face);
    vec3 a = in_camera(row(vertices, vertex.x));
    vec3 b = in_camera(row(vertices, vertex.y));
    vec3 c = in_camera(row(vertices, vertex.z));
    Triangle t;
    t.nearness = 1.0 / vec3(a.z, b.z, c.z);
    t.a = pixel_of(a.xy * t.nearness.x);
    t.b = pixel_of(b.xy * t.nearness.y);
    t.c = pixel_of(c.xy * t.nearness.z);
    t.side = sign(turn_of(t.b - t.a, t.c - t.a));
    t.from = ivec2(clamp(ceil(min(t.a, min(t.b, t.c)) - 0.5), vec2(0.0), vec2(size)));
    t.to = ivec2(clamp(floor(max(t.a, max(t.b, t.c)) - 0.5), vec2(-1.0), vec2(size - 1)));
    return t;
}

// Its distance along the axis in the middle of a pixel, or -1 where it is not. Neighbours see the
// edge between them with the same numbers, so that no ray slips through.
float distance_at(Triangle t, ivec2 at) {
    vec2 middle = vec2(at) + 0.5;
    vec2 a = t.a - middle, b = t.b - middle, c = t.c - middle;
    vec3 share = t.side * vec3(turn_of(b, c), turn_of(c, a), turn_of(a, b));
    float whole = share.x + share.y + share.z;
    bool hits = min(share.x, min(share.y, share.z)) >= 0.0 && whole > 0.0;
    precise float distance = whole / dot(share, t.nearness);
    return hits ? distance : -1.0;
}

// Software rasterisers skip no branch, but they do leave loops: hence loops of 0 or 1 turns.

#ifndef JUDGE
void main() {
    uint i = gl_GlobalInvocationID.x, number = i >> size_log2;
    uint cluster = clusters[first_cluster + min(number, n_clusters - 1u)];
    uint face = (cluster << size_log2) + (i & ((1u << size_log2) - 1u));
    int alive = number < n_clusters ? 1 : 0;
    for (int once = 0; once < alive; ++once) {
        Triangle t = triangle_of(face);
        if (t.side <= 0.0 && cull_backs > 0.5) t.from = size;   // CropBack
        for (int y = t.from.y; y <= t.to.y; ++y) {
            for (int x = t.from.x; x <= t.to.x; ++x) {
                float distance = distance_at(t, ivec2(x, y));
                uint bits = floatBitsToUint(distance);
                if (distance > 0.0) atomicMin(depth[(first_row + y) * size.x + x], bits);
            }
        }
    }
}
#else
bool accepts(float distance, vec3 ray, float height) {   // CropNear, maxD, CropNorm by the ray
    return distance >= working_range.x && distance <= working_range.y
        && height >= min_cos.x * distance * length(ray);
}

float nearest(ivec2 at) {
    float far = uintBitsToFloat(depth[(first_row + at.y) * size.x + at.x]);
#ifdef DRAWN
    float z = 2.0 * texelFetch(drawn, ivec2(at.x, first_row + at.y), 0).r - 1.0;
    if (z < 1.0) far = min(far, 2.0 * clip.y * clip.x / (clip.y + clip.x - z * (clip.y - clip.x)));
#endif
    return far;
}

// As crops.unhidden has it: a pixel's depth is that of its own middle, so it is compared with
// the face's plane there. Nearly edge on, the plane runs away: it is believed to half the depth.
bool shows_centre(vec3 centre, vec3 normal, float height) {
    vec2 spot = pixel_of(centre.xy / centre.z);
    ivec2 at = clamp(ivec2(floor(spot)), ivec2(0), size - 1);
    float falls = -dot(normal, ray_through(vec2(at) + 0.5));
    float plane = falls * centre.z > 0.5 * height ? height / falls : 0.5 * centre.z;
    plane = clamp(plane, 0.5 * centre.z, centre.z);
    return all(greaterThanEqual(spot, vec2(0.0))) && all(lessThanEqual(spot, vec2(size)))
        && accepts(centre.z, centre / centre.z, height)
        && nearest(at) >= plane - tolerance * centre.z;
}

bool shows_pixels(uint face, float height) {
    Triangle t = triangle_of(face);
    int pixels = 0;
    for (int y = t.from.y; y <= t.to.y; ++y) {
        for (int x = t.from.x; x <= t.to.x; ++x) {
            float distance = distance_at(t, ivec2(x, y));
            if (distance > 0.0 && accepts(distance, ray_through(vec2(x, y) + 0.5), height)
                && distance <= nearest(ivec2(x, y)) * (1.0 + 1e-6)) ++pixels;
            if (pixels >= min_pixels) { x = t.to.x; y = t.to.y; }
        }
    }
    return pixels >= min_pixels;
}

bool is_seen(uint face, bool is_small) {
    vec3 centre = in_camera(row(centroids, face));
    vec3 normal = mat3(world_to_camera) * uintBitsToFloat(row(normals, face).xyz);
    float height = -dot(normal, centre);   // of the eye above the face's plane
    bool faces = height > 0.0 && -normal.z >= min_cos.y;   // CropBack, CropNorm by the axis
    bool shows = false;
#ifdef LOOK_AT_CENTRE
    shows = faces && shows_centre(centre, normal, height);
#endif
#ifdef COUNT_PIXELS
    int more = faces && is_small && !shows ? 1 : 0;
    for (int once = 0; once < more; ++once) shows = shows_pixels(face, height);
#endif
    return shows;
}

#ifdef COUNT_PIXELS
void main() {
    uint number = first_cluster + min(gl_GlobalInvocationID.x >> size_log2, n_clusters - 1u);
    uint k = gl_GlobalInvocationID.x & ((1u << size_log2) - 1u);
    bool is_small = number < first_cluster + n_small;
    if (is_seen((clusters[number] << size_log2) + k, is_small)) atomicOr(seen[number], 1u << k);
}
#else
void main() {
    uint number = first_cluster + min(gl_GlobalInvocationID.x, n_clusters - 1u);
    uint first = clusters[number] << size_log2, bits = 0u;
    for (uint k = 0u; k < 1u << size_log2; ++k) bits |= is_seen(first + k, false) ? 1u << k : 0u;
    seen[number] = bits;
}
#endif
#endif
