#version 300 es
// What the pointer is on: first_id + face of a mesh drawn as three corners a face.
in vec3 position;   // relative to the page's origin, axes of the world
uniform mat4 world_to_clip;
uniform highp uint first_id;
flat out highp uint id;

void main() {
    id = first_id + uint(gl_VertexID) / 3u;
    gl_Position = world_to_clip * vec4(position, 1.0);
}
