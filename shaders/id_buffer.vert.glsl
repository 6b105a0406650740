#version 330 core
// Places a face for the ID buffer. The last vertex of a face carries what the whole face shares.
// in:  position   vertex, world frame relative to the model's middle, scene unit
//      face_id    face index + 1, 0 for obstacles; read from the provoking (last) vertex
//      normal     unit normal of that face, 0 for obstacles
// out: id         as face_id
//      height     distance of the eye above the face's plane, scene unit; < 0 behind it
//      axis_cos   cosine of the incidence measured along the optical axis
in vec3 position;
in uint face_id;
in vec3 normal;

uniform mat4 world_to_clip;
uniform vec3 eye;        // optical centre, as position
uniform vec3 backwards;  // unit vector against the optical axis, world frame

flat out uint id;
flat out float height;
flat out float axis_cos;

void main() {
    gl_Position = world_to_clip * vec4(position, 1.0);
    id = face_id;
    height = dot(normal, eye - position);
    axis_cos = dot(normal, backwards);
}
