#version 300 es
// A line with soft edges, premultiplied alpha.
precision highp float;
in vec4 color;
in float across;
in float half_width;
out vec4 fragment;

void main() {
    float cover = clamp(half_width + 0.5 - abs(across), 0.0, 1.0);
    fragment = vec4(color.rgb, 1.0) * color.a * cover;
}
