#version 330 core
// Soft light that keeps the palette readable: sky and ground, a key light over the viewer's left
// shoulder, a head light. Both sides are lit; a back shows a grey, its colour belongs to the front.
// Light is summed in linear colour and written as sRGB.
in vec3 world_position;
in vec3 world_normal;
flat in vec4 color;

uniform vec3 eye;          // optical centre; direction towards the eye in parallel projection
uniform float eye_is_near; // 1 for perspective, 0 for parallel projection
uniform vec3 up;           // unit, of the study
uniform vec3 key_light;    // unit, towards the light
uniform float stripe;      // pixels from stripe to stripe
uniform float relief;      // 0 flat colour .. 1 full light and shade

out vec4 fragment;

void main() {
    vec3 to_eye = normalize(eye - eye_is_near * world_position);
    vec3 n = normalize(world_normal);
    bool is_front = gl_FrontFacing;
    if (!is_front) n = -n;
    // a smooth normal may point away near the outline: bend it back
    float away = dot(n, to_eye);
    if (away < 0.0) n = normalize(n - to_eye * (away - 0.02));

    vec3 albedo = pow(color.rgb, vec3(2.2));
    if (color.a < 0.75 && is_front) {
        float at = fract((gl_FragCoord.x + gl_FragCoord.y) / stripe);
        albedo = mix(albedo, albedo * 0.36, step(0.62, at));
    }
    if (!is_front) albedo = vec3(0.078, 0.070, 0.063);

    float facing = max(0.0, dot(n, to_eye));
    float sky = 0.5 + 0.5 * dot(n, up);
    float key = max(0.0, 0.15 + 0.85 * dot(n, key_light));
    vec3 light = mix(vec3(0.22, 0.21, 0.22), vec3(0.37, 0.39, 0.42), sky)
               + key * vec3(0.50, 0.48, 0.45) + 0.28 * facing;
    light = mix(vec3(1.0), light, relief);
    vec3 srgb = pow(clamp(albedo * light, 0.0, 1.0), vec3(1.0 / 2.2));
    fragment = vec4(srgb, is_front ? 1.0 : 0.0);   // the legend wants to know of backs
}
