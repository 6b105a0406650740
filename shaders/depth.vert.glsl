#version 330 core
// Places a face for the depth buffer alone.
// in:  position   vertex, world frame relative to the model's middle, scene unit
in vec3 position;

invariant gl_Position;      // the same depths whether or not IDs are drawn

uniform mat4 world_to_clip;

void main() { gl_Position = world_to_clip * vec4(position, 1.0); }
