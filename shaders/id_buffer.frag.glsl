#version 330 core
// Writes the ID of the face that a pixel shows, or 0 where the sensor refuses it (Sec. 2.1.1:
// CropBack and CropNorm by the incidence, CropNear and maxD by the depth along the optical axis).
// in:  id, height   of the face, see id_buffer.vert.glsl
// out: face_id      into the R32UI target; depth goes into the depth buffer untouched, or, where
//                   EVEN_DEPTH is defined, along the optical axis as a share of clip_range:
//                   OpenGL's own tells far things apart badly if the range begins very near
// LENS is defined where the window does not look along the sensor's optical axis, or the working range
// is the distance from the optical centre.
// REFUSED_HIDE is defined where back and too oblique faces hide what lies behind them.
#include "filters.glsl"
flat in uint id;
flat in float height;

uniform vec4 pixel_to_tangent;  // scale xy and offset zw from gl_FragCoord.xy to x/-z, y/-z
uniform float min_ray_cos;      // cosine of the largest incidence by the true ray, or 0: any
uniform float min_distance;     // working range, scene unit
uniform float max_distance;
#ifdef LENS
uniform vec3 axis;              // the sensor's own: right, up and depth of the window
uniform int by_range;           // whether the range is from the optical centre, not along the axis
#endif
#ifdef EVEN_DEPTH
uniform vec2 clip_range;        // depths that the depth buffer holds, scene unit
uniform float back;             // share of the depth by which a face recedes behind what lies in
                                // one place with it
#endif

out uint face_id;

void main() {
    float depth = 1.0 / gl_FragCoord.w;
    vec2 tangent = gl_FragCoord.xy * pixel_to_tangent.xy + pixel_to_tangent.zw;
    float distance_squared = depth * depth * (1.0 + dot(tangent, tangent));
    bool faces = crop_back(height) && crop_norm_by_ray(height, distance_squared, min_ray_cos);
#ifndef REFUSED_HIDE
    if (!faces && id != 0u) discard;
#endif
    float far_off = depth;
#ifdef LENS
    far_off = by_range != 0 ? sqrt(distance_squared) : depth * dot(axis, vec3(tangent, 1.0));
#endif
    bool in_range = crop_near(far_off, min_distance) && crop_far(far_off, max_distance);
    face_id = faces && in_range ? id : 0u;
#ifdef EVEN_DEPTH
    gl_FragDepth = (depth * (1.0 + back) - clip_range.x) / (clip_range.y - clip_range.x);
#endif
}
