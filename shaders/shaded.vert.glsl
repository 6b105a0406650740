#version 330 core
// A coloured surface for people: three corners a face, nothing shared.
// in:  position   corner, world frame relative to the picture's origin, scene unit
//      normal     unit, smooth over gentle edges, world frame
//      tint       sRGB; opacity 1 plain, below 1 striped
// out: what shaded.frag.glsl lights
in vec3 position;
in vec3 normal;
in vec4 tint;

uniform mat4 world_to_clip;

out vec3 world_position;
out vec3 world_normal;
flat out vec4 color;

void main() {
    gl_Position = world_to_clip * vec4(position, 1.0);
    world_position = position;
    world_normal = normal;
    color = tint;
}
