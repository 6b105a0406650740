#version 300 es
// The page's meshes: three corners a face, not indexed, so that the face is gl_VertexID / 3.
in vec3 position;   // relative to the page's origin, axes of the world
in vec4 normal;     // unit, world axes
uniform mat4 world_to_clip;
out vec3 world_position;
out vec3 world_normal;
out vec3 corner;                  // barycentric
flat out int face;

void main() {
    face = gl_VertexID / 3;
    int k = gl_VertexID % 3;
    corner = vec3(k == 0, k == 1, k == 2);
    world_position = position;
    world_normal = normal.xyz;
    gl_Position = world_to_clip * vec4(position, 1.0);
}
