#version 330 core
// Places a face for the ID buffer. The last vertex of a face carries what the whole face shares.
// in:  position   vertex, world frame relative to the model's middle, scene unit
//      face_id    face index + 1, 0 for obstacles; read from the provoking (last) vertex
//      normal     unit normal of that face, 0 for obstacles
// out: id         as face_id
//      height     distance of the eye above the face's plane, scene unit; negative behind it,
//                 and where the incidence by the optical axis is too large
#include "filters.glsl"
in vec3 position;
in uint face_id;
in vec3 normal;

invariant gl_Position;      // the same depths whether or not IDs are drawn

uniform mat4 world_to_clip;
uniform vec3 eye;           // optical centre, as position
uniform vec3 backwards;     // unit vector against the optical axis, world frame
uniform float min_axis_cos; // cosine of the largest incidence by the optical axis, or -2: any

flat out uint id;
flat out float height;

void main() {
    gl_Position = world_to_clip * vec4(position, 1.0);
    id = face_id;
    bool faces = crop_norm_by_axis(dot(normal, backwards), min_axis_cos);
    height = faces ? dot(normal, eye - position) : -1.0;
}
