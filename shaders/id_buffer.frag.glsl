#version 330 core
// Writes the ID of the face that a pixel shows, or 0 where the sensor refuses it (Sec. 2.1.1:
// CropBack and CropNorm by the incidence, CropNear by the depth along the optical axis).
// in:  id, height, axis_cos   of the face, see id_buffer.vert.glsl
// out: face_id                into the R32UI target; depth goes into the depth buffer untouched
flat in uint id;
flat in float height;
flat in float axis_cos;

uniform vec4 pixel_to_tangent;  // scale xy and offset zw from gl_FragCoord.xy to x/-z, y/-z
uniform float min_cos;          // cosine of max_incidence
uniform float min_distance;     // depth along the optical axis, scene unit
uniform bool by_axis;           // incidence by the optical axis instead of the true ray
uniform bool refused_hide;      // whether back and oblique faces hide what lies behind them

out uint face_id;

void main() {
    float depth = 1.0 / gl_FragCoord.w;
    vec2 tangent = gl_FragCoord.xy * pixel_to_tangent.xy + pixel_to_tangent.zw;
    float distance_to_eye = depth * sqrt(1.0 + dot(tangent, tangent));
    bool faces = by_axis ? axis_cos >= min_cos && height > 0.0
                         : height >= min_cos * distance_to_eye && height > 0.0;
    if (!faces && !refused_hide && id != 0u) discard;
    face_id = faces && depth >= min_distance ? id : 0u;
}
