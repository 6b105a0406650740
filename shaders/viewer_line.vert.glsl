#version 300 es
// Lines of any width: one instance a segment, drawn as a strip of four corners.
in vec3 from;    // relative to the page's origin
in vec3 to;
in vec4 tint;    // sRGB and opacity
in float width;  // CSS pixels
uniform mat4 world_to_clip;
uniform vec2 viewport;   // device pixels
uniform float pixel;     // device pixels a CSS pixel
out vec4 color;
out float across;        // device pixels from the middle of the line
out float half_width;

void main() {
    vec4 a = world_to_clip * vec4(from, 1.0);
    vec4 b = world_to_clip * vec4(to, 1.0);
    // Cut at the near plane: behind the eye a screen position means nothing.
    float da = a.z + a.w, db = b.z + b.w;
    if (da < 0.0 && db < 0.0) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
    if (da < 0.0) a = mix(a, b, da / (da - db));
    if (db < 0.0) b = mix(b, a, db / (db - da));
    vec2 screen_a = a.xy / a.w * viewport * 0.5, screen_b = b.xy / b.w * viewport * 0.5;
    vec2 along = screen_b - screen_a;
    along = length(along) > 1e-6 ? normalize(along) : vec2(1.0, 0.0);
    float side = float(gl_VertexID & 1) * 2.0 - 1.0;
    vec4 end = gl_VertexID < 2 ? a : b;
    half_width = 0.5 * width * pixel;
    across = side * (half_width + 1.0);
    end.xy += vec2(-along.y, along.x) * across / (viewport * 0.5) * end.w;
    color = tint;
    gl_Position = end;
}
