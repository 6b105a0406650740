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

// Two texels a face, 2048 faces a line: nine coordinates of 28 bits. Eight words have one each in
// their lower bits, a.xyz, b.xyz and c.xy; c.z is in the upper bits, lowest first. Fetching is the
// dearest step in software, so nothing is fetched that these tell.
layout(binding = 0) uniform usampler2D packed_faces;
layout(binding = 1) uniform sampler2D drawn;        // OpenGL depth

layout(std430, binding = 0) readonly buffer Clusters { uint clusters[]; };
layout(std430, binding = 1) buffer Depth { uint depth[]; };
layout(std430, binding = 2) buffer Seen { uint seen[]; };

layout(std140, binding = 0) uniform View {
    mat4 world_to_camera;       // of points relative to the origin
    vec2 working_range;         // minD, maxD as depth
    vec2 min_cos;               // of the incidence: by the ray, 0 for any; by the axis, -2 for any
    vec2 clip;                  // near and far plane of what was drawn
    vec2 unused;                // so that what follows is aligned
    vec4 tangent_to_pixel;      // scale xy, offset zw
    vec4 lattice;               // of the faces: its middle relative to the origin xyz, its step w
    float tolerance;            // share of its depth by which something nearer hides a centre
    float cull_backs;           // 1: backs hide nothing
    ivec2 size;                 // of the image, pixels
    int first_row;              // of this view in depth
    int min_pixels;             // in how many a face must show, at least 1
    uint size_log2;             // faces in a cluster, at most 32
    uint first_cluster, n_clusters, n_small;   // in clusters; those with small faces come first
};

const uint COORDINATE = (1u << 28) - 1u;
const int MIDDLE = 1 << 27;

// A face's corners on the lattice.
ivec3[3] corners_of(uint face) {
    ivec2 at = ivec2(2u * (face & 2047u), face >> 11);
    uvec4 one = texelFetch(packed_faces, at, 0);
    uvec4 other = texelFetch(packed_faces, at + ivec2(1, 0), 0);
    uvec4 low = one >> 28, high = other >> 28;
    uint last = low.x | low.y << 4 | low.z << 8 | low.w << 12
        | high.x << 16 | high.y << 20 | high.z << 24;
    one &= COORDINATE;
    other &= COORDINATE;
    return ivec3[3](
        ivec3(one.xyz) - MIDDLE, ivec3(one.w, other.xy) - MIDDLE, ivec3(other.zw, last) - MIDDLE
    );
}

// precise: both passes, and both faces at an edge, must get the same numbers.
vec3 in_camera(ivec3 corner) {
    precise vec3 place = vec3(corner) * lattice.w + lattice.xyz;
    precise vec4 seen = world_to_camera * vec4(place, 1.0);
    return seen.xyz;
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

Triangle triangle_of(vec3 a, vec3 b, vec3 c) {
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

// A walk over the pixels that a face may cover, row by row, from its edges on the left to those on
// the right. It is a little too wide, for distance_at alone decides.
struct Walk {
    ivec2 at;
    int end;                        // of the row
    vec3 left, right;               // where edges cross the middle of the row
    vec3 left_lean, right_lean;     // how far they move to the next
};

const float SPARE = 0.01;           // pixels, far beyond what float32 rounds
const float LEVEL = 1e-4;           // an edge that rises by less bounds no row
const float ANYWHERE = 1e5;

void begin_row(Triangle t, inout Walk walk) {
    float left = max(walk.left.x, max(walk.left.y, walk.left.z));
    float right = min(walk.right.x, min(walk.right.y, walk.right.z));
    walk.at.x = int(clamp(ceil(left), float(t.from.x), float(t.to.x)));
    walk.end = int(clamp(floor(right), -1.0, float(t.to.x)));
}

Walk first_of(Triangle t, bool is_left_out) {
    vec3 x = vec3(t.a.x, t.b.x, t.c.x) - 0.5, y = vec3(t.a.y, t.b.y, t.c.y) - 0.5;
    vec3 rise = y.yzx - y, lean = (x.yzx - x) / rise, spare = SPARE * (1.0 + abs(lean));
    vec3 crossing = x + (float(t.from.y) - y) * lean;
    bvec3 on_left = lessThan(t.side * rise, vec3(-LEVEL));
    bvec3 on_right = greaterThan(t.side * rise, vec3(LEVEL));
    bool is_empty = is_left_out || t.from.x > t.to.x;
    Walk walk;
    walk.at.y = is_empty ? t.to.y + 1 : t.from.y;
    walk.left = mix(vec3(-ANYWHERE), crossing - spare, on_left);
    walk.right = mix(vec3(ANYWHERE), crossing + spare, on_right);
    walk.left_lean = mix(vec3(0.0), lean, on_left);
    walk.right_lean = mix(vec3(0.0), lean, on_right);
    begin_row(t, walk);
    return walk;
}

void go_on(Triangle t, inout Walk walk) {
    Walk next = walk;
    next.left += next.left_lean;
    next.right += next.right_lean;
    next.at.y += 1;
    begin_row(t, next);
    walk.at.x += 1;
    if (walk.at.x > walk.end) walk = next;
}

// Software skips no branch, and a loop within a loop costs it as much as all the rest: a walk is one
// loop, and an invocation too many does again what the last cluster's do.

#ifndef JUDGE
void main() {
    uint i = gl_GlobalInvocationID.x, number = i >> size_log2;
    uint cluster = clusters[first_cluster + min(number, n_clusters - 1u)];
    uint face = (cluster << size_log2) + (i & ((1u << size_log2) - 1u));
    ivec3[3] corners = corners_of(face);
    Triangle t = triangle_of(in_camera(corners[0]), in_camera(corners[1]), in_camera(corners[2]));
    bool is_left_out = t.side <= 0.0 && cull_backs > 0.5;   // CropBack
    for (Walk walk = first_of(t, is_left_out); walk.at.y <= t.to.y; go_on(t, walk)) {
        float distance = distance_at(t, walk.at);
        uint bits = floatBitsToUint(distance);
        if (distance > 0.0) atomicMin(depth[(first_row + walk.at.y) * size.x + walk.at.x], bits);
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
    float z = 2.0 * texelFetch(drawn, at, 0).r - 1.0;
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

bool shows_pixels(Triangle t, float height, bool is_left_out) {
    int pixels = 0;
    Walk walk = first_of(t, is_left_out);
    for (; walk.at.y <= t.to.y && pixels < min_pixels; go_on(t, walk)) {
        float distance = distance_at(t, walk.at);
        if (distance > 0.0 && accepts(distance, ray_through(vec2(walk.at) + 0.5), height)
            && distance <= nearest(walk.at) * (1.0 + 1e-6)) ++pixels;
    }
    return pixels >= min_pixels;
}

bool is_seen(uint face, bool is_small) {
    ivec3[3] corners = corners_of(face);
    vec3 a = in_camera(corners[0]), b = in_camera(corners[1]), c = in_camera(corners[2]);
    vec3 centre = (a + b + c) / 3.0;
    vec3 normal = cross(vec3(corners[1] - corners[0]), vec3(corners[2] - corners[0]));
    normal = normalize(mat3(world_to_camera) * normal);
    float height = -dot(normal, centre);   // of the eye above the face's plane
    bool faces = height > 0.0 && -normal.z >= min_cos.y;   // CropBack, CropNorm by the axis
    bool shows = false;
#ifdef LOOK_AT_CENTRE
    shows = faces && shows_centre(centre, normal, height);
#endif
#ifdef COUNT_PIXELS
    bool is_left_out = shows || !faces || !is_small;
    shows = shows_pixels(triangle_of(a, b, c), height, is_left_out) || shows;
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
