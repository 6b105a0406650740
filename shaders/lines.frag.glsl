#version 330 core
// A line with soft edges, premultiplied alpha.
in vec4 color;
in float across;
in float half_width;

out vec4 fragment;

void main() {
    fragment = vec4(color.rgb, 1.0) * color.a * clamp(half_width + 0.5 - abs(across), 0.0, 1.0);
}
