#version 330 core
// Lines of any width: one instance a segment, drawn as a strip of four corners.
// in:  start, end   world frame relative to the picture's origin, scene unit
//      tint         sRGB and opacity
//      width        pixels
// out: across       pixels from the middle of the line
in vec3 start;
in vec3 end;
in vec4 tint;
in float width;

uniform mat4 world_to_clip;
uniform vec2 viewport;   // pixels
uniform float opacity;   // of all lines

out vec4 color;
out float across;
out float half_width;

void main() {
    vec4 a = world_to_clip * vec4(start, 1.0);
    vec4 b = world_to_clip * vec4(end, 1.0);
    // Cut at the near plane: behind the eye a screen position means nothing.
    float da = a.z + a.w, db = b.z + b.w;
    if (da <= 0.0 && db <= 0.0) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
    if (da < 0.0) a = mix(a, b, da / (da - db));
    if (db < 0.0) b = mix(b, a, db / (db - da));
    vec2 along = (b.xy / b.w - a.xy / a.w) * viewport;
    along = length(along) > 1e-6 ? normalize(along) : vec2(1.0, 0.0);
    float side = float(gl_VertexID & 1) * 2.0 - 1.0;
    vec4 place = gl_VertexID < 2 ? a : b;
    half_width = 0.5 * width;
    across = side * (half_width + 1.0);
    place.xy += vec2(-along.y, along.x) * across / (0.5 * viewport) * place.w;
    color = vec4(tint.rgb, tint.a * opacity);
    gl_Position = place;
}
