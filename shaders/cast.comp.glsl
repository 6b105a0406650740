#version 430 core
// Small faces without a rasteriser: one invocation a face casts a ray through the middle of each
// pixel that the face may cover. What a draw spends on a triangle of a few pixels is mostly
// set-up, and this has none. The camera frame here is (right, up, depth along the optical axis)
// from the eye; rows of pixels count upwards.
//
// Without JUDGE every chosen face is cast:
// out: depth   the nearest distance along the axis a pixel, as bits: those of floats sort alike
// With JUDGE every chosen face is judged against these depths, and where DRAWN is defined against
// a drawn depth buffer too: by its pixels (COUNT_PIXELS), or else its centre (LOOK_AT_CENTRE).
// out: seen    one bit a face
layout(local_size_x = 64) in;

// Tables, 4096 rows of four words a line; coordinates are the bits of floats.
layout(binding = 0) uniform usampler2D vertices;    // xyz: world frame relative to the origin
layout(binding = 1) uniform usampler2D corners;     // xyz: vertex numbers
layout(binding = 2) uniform usampler2D centroids;   // xyz: as vertices; w: index of the face
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
    int first_row, first_word;  // of this view in depth and in seen
    uint first_cluster, n_clusters, n_small;   // in clusters; those with small faces come first
    uint size_log2;             // faces in one
    int min_pixels;             // in how many a face must show, at least 1
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

#ifdef JUDGE
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
#endif

void main() {
    uint i = gl_GlobalInvocationID.x, number = i >> size_log2;
    uint cluster = clusters[first_cluster + min(number, n_clusters - 1u)];
    uint face = (cluster << size_log2) + (i & ((1u << size_log2) - 1u));
    // Software rasterisers skip no branch, but they do leave loops: hence loops of 0 or 1 turns.
    int alive = number < n_clusters ? 1 : 0;
#ifdef JUDGE
    uvec4 place = row(centroids, face);
    vec3 centre = in_camera(place);
    vec3 normal = mat3(world_to_camera) * uintBitsToFloat(row(normals, face).xyz);
    float height = -dot(normal, centre);   // of the eye above the face's plane
    if (height <= 0.0 || -normal.z < min_cos.y) alive = 0;   // CropBack, CropNorm by the axis
    bool is_seen = false;
    int pixels = 0;
#ifdef LOOK_AT_CENTRE
    for (int once = 0; once < alive; ++once) is_seen = shows_centre(centre, normal, height);
#endif
#ifdef COUNT_PIXELS
    if (number >= n_small || is_seen) alive = 0;
#else
    alive = 0;
#endif
#endif
    for (int once = 0; once < alive; ++once) {
        uvec4 vertex = row(corners, face);
        vec3 a = in_camera(row(vertices, vertex.x));
        vec3 b = in_camera(row(vertices, vertex.y));
        vec3 c = in_camera(row(vertices, vertex.z));
        vec3 nearness = 1.0 / vec3(a.z, b.z, c.z);   // linear in the image
        vec2 pa = pixel_of(a.xy * nearness.x);
        vec2 pb = pixel_of(b.xy * nearness.y);
        vec2 pc = pixel_of(c.xy * nearness.z);
        ivec2 from = ivec2(clamp(ceil(min(pa, min(pb, pc)) - 0.5), vec2(0.0), vec2(size)));
        ivec2 to = ivec2(clamp(floor(max(pa, max(pb, pc)) - 0.5), vec2(-1.0), vec2(size - 1)));
        float side = sign(turn_of(pb - pa, pc - pa));
        if (side <= 0.0 && cull_backs > 0.5) from = size;   // CropBack
        for (int y = from.y; y <= to.y; ++y) {
            for (int x = from.x; x <= to.x; ++x) {
                // Neighbours see the edge between them with the same numbers, so that no ray
                // slips through.
                vec2 middle = vec2(x, y) + 0.5;
                vec2 qa = pa - middle, qb = pb - middle, qc = pc - middle;
                vec3 share = side * vec3(turn_of(qb, qc), turn_of(qc, qa), turn_of(qa, qb));
                float whole = share.x + share.y + share.z;
                bool hits = min(share.x, min(share.y, share.z)) >= 0.0 && whole > 0.0;
                precise float distance = whole / dot(share, nearness);
#ifdef JUDGE
                if (hits && accepts(distance, ray_through(middle), height)
                    && distance <= nearest(ivec2(x, y)) * (1.0 + 1e-6)) ++pixels;
                if (pixels >= min_pixels) { x = to.x; y = to.y; }
#else
                if (hits) atomicMin(depth[(first_row + y) * size.x + x], floatBitsToUint(distance));
#endif
            }
        }
    }
#ifdef JUDGE
    if (is_seen || pixels >= min_pixels) {
        atomicOr(seen[uint(first_word) + (place.w >> 5)], 1u << (place.w & 31u));
    }
#endif
}
