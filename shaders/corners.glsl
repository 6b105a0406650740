// The corners of a face as surface.py packs them: included by ask and hide, after view.glsl.
layout(binding = 0) uniform usampler2D packed_faces;    // two texels a face: 9 x 28 bits

const uint COORDINATE = (1u << 28) - 1u;
const int MIDDLE = 1 << 27;

vec3 from_lattice(ivec3 place) {
    return vec3(place - MIDDLE) * lattice.w + lattice.xyz;
}

// Corners of a face relative to the origin.
vec3[3] corners_of(uint face) {
    ivec2 at = ivec2(2u * (face % FACES_A_LINE), face / FACES_A_LINE);
    uvec4 one = texelFetch(packed_faces, at, 0);
    uvec4 other = texelFetch(packed_faces, at + ivec2(1, 0), 0);
    uvec4 low = one >> 28, high = other >> 28;
    uint last = low.x | low.y << 4 | low.z << 8 | low.w << 12
        | high.x << 16 | high.y << 20 | high.z << 24;
    ivec4 first = ivec4(one & COORDINATE), second = ivec4(other & COORDINATE);
    return vec3[3](
        from_lattice(first.xyz),
        from_lattice(ivec3(first.w, second.xy)),
        from_lattice(ivec3(second.zw, int(last)))
    );
}
