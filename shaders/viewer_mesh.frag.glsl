#version 300 es
// Soft light that keeps the palette readable: sky and ground, a key light over the viewer's
// left shoulder, and a darkened rim. Unseen faces carry stripes, so that they do not hang on
// hue alone. Light is summed in linear colour; output is sRGB with premultiplied alpha.
precision highp float;
precision highp int;
in vec3 world_position;
in vec3 world_normal;
in vec3 corner;
flat in int face;
uniform highp usampler2D paint;   // palette entry of each face, row by row
uniform sampler2D palette;        // sRGB, one row
uniform vec3 eye;         // relative to the page's origin
uniform vec3 up;          // unit, of the study
uniform vec3 key_light;   // unit, towards the light
uniform int marked;       // face under the pointer, -1 for none
uniform float edges;      // opacity of the mesh's edges, 0 .. 1
uniform float pixel;      // device pixels a CSS pixel
uniform float ghost;      // below 1: only unseen faces, flat, as a veil over what hides them
uniform float veil;       // opacity of what one looks through, else 1
out vec4 fragment;

const uint UNSEEN = 0u;

void main() {
    int width = textureSize(paint, 0).x;
    uint entry = texelFetch(paint, ivec2(face % width, face / width), 0).r;
    if (ghost < 1.0) {
        if (entry != UNSEEN) discard;
        fragment = vec4(texelFetch(palette, ivec2(entry, 0), 0).rgb, 1.0) * ghost;
        return;
    }
    vec3 to_eye = normalize(eye - world_position);
    vec3 n = world_normal;
    if (dot(n, n) < 0.01) n = cross(dFdx(world_position), dFdy(world_position));
    n = normalize(n);
    if (!gl_FrontFacing) n = -n;

    vec3 albedo = pow(texelFetch(palette, ivec2(entry, 0), 0).rgb, vec3(2.2));
    bool striped = entry == UNSEEN && gl_FrontFacing;
    if (striped) {
        float wave = sin((gl_FragCoord.x + gl_FragCoord.y) * 0.9 / pixel);
        albedo = mix(albedo, mix(albedo * 0.28, vec3(1.0), 0.06), smoothstep(-0.25, 0.35, wave) * 0.75);
    }
    if (!gl_FrontFacing) albedo = mix(vec3(dot(albedo, vec3(0.3, 0.5, 0.2))), albedo, 0.25) * 0.22;

    float sky = 0.5 + 0.5 * dot(n, up);
    float key = max(0.0, 0.25 + 0.75 * dot(n, key_light));
    float facing = max(0.0, dot(n, to_eye));
    vec3 light = mix(vec3(0.22, 0.21, 0.23), vec3(0.52, 0.54, 0.58), sky)
               + key * vec3(0.64, 0.62, 0.59) + 0.12 * facing;
    light *= 0.5 + 0.5 * smoothstep(0.0, 0.6, facing);
    if (striped) light = mix(light, vec3(1.0), 0.45);   // loud also where it is dark
    vec3 lit = albedo * light;

    vec3 away = corner / max(fwidth(corner), 1e-6);     // device pixels from each edge
    float near_edge = min(away.x, min(away.y, away.z)) / pixel;
    float line = 1.0 - smoothstep(0.3, 1.3, near_edge);
    float room = smoothstep(0.35, 0.08, max(fwidth(corner).x, max(fwidth(corner).y, fwidth(corner).z)) * pixel);
    lit *= 1.0 - 0.55 * edges * line * room;
    if (face == marked) lit = mix(lit, vec3(1.0), 0.35 + 0.65 * (1.0 - smoothstep(1.0, 2.2, near_edge)));

    vec3 srgb = pow(clamp(lit, 0.0, 1.0), vec3(1.0 / 2.2));
    fragment = vec4(srgb, 1.0) * veil;
}
