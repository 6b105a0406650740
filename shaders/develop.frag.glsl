#version 330 core
// Makes the picture of the parts: darkens crevices and draws outlines from the depth buffer (form
// without a shadow), lays the lines on top, and averages the samples of each pixel.
// Opposite neighbours are taken in pairs, so that a plane, however oblique, stays as it is.
uniform sampler2D lit;
uniform sampler2D depth;
uniform sampler2D lines;   // premultiplied alpha
uniform int samples;       // per pixel, along each side
uniform vec4 unproject;    // distance = x / (y + z depth) where w is 1, x + z depth where w is 0
uniform float radius;      // samples, reach of the darkening
uniform float reach;       // scene unit that radius spans at the focus
uniform float outline;     // samples, width of the outlines
uniform float strength;    // 0 leaves all as it is, 1 is full

out vec4 fragment;

float depth_at(ivec2 at) {
    return texelFetch(depth, clamp(at, ivec2(0), textureSize(depth, 0) - 1), 0).r;
}

float distance_at(ivec2 at) {
    float z = depth_at(at);
    return unproject.w > 0.5 ? unproject.x / (unproject.y + unproject.z * z)
                             : unproject.x + unproject.z * z;
}

// How much a neighbour stands out, -limit .. limit; what is far in front, as a table over the
// floor, darkens nothing: it would smear.
float nearer(float by, float limit) {
    return clamp(by, -limit, limit) * clamp(2.0 - by / reach, 0.0, 1.0);
}

// Software rasterisers skip no branch, but they do leave loops: hence turns that may be 0.
float crevice(ivec2 here, float middle, int turns) {
    float hidden = 0.0;
    for (int i = 0; i < turns; ++i) {   // a Vogel spiral: even over the disc
        float r = radius * sqrt((float(i) + 0.6) / 16.0), angle = 2.399963 * float(i);
        ivec2 offset = ivec2(round(r * vec2(cos(angle), sin(angle))));
        float limit = reach * length(vec2(offset)) / radius + 1e-6;
        float a = nearer(middle - distance_at(here + offset), limit);
        float b = nearer(middle - distance_at(here - offset), limit);
        hidden += max(0.0, a + b) / (2.0 * limit);
    }
    return 1.0 - strength * 0.6 * smoothstep(0.0, 0.75, hidden / 16.0);
}

float rim(ivec2 here, float middle, int turns) {
    float step_out = 0.0;
    for (int i = 0; i < turns; ++i) {
        ivec2 offset = ivec2(round(outline * vec2(0.8, i == 0 ? 0.8 : -0.8)));
        step_out = max(step_out, distance_at(here + offset) + distance_at(here - offset) - 2.0 * middle);
    }
    return 1.0 - strength * 0.62 * smoothstep(0.25, 0.6, step_out / reach);
}

void main() {
    ivec2 corner = ivec2(gl_FragCoord.xy) * samples;
    ivec2 inner = corner + samples / 2;
    bool is_covered = depth_at(inner) < 1.0;
    float light = crevice(inner, distance_at(inner), is_covered ? 16 : 0);
    vec3 sum = vec3(0.0);
    float front = 1.0;         // 0 where a sample shows a back
    for (int y = 0; y < samples; ++y) {
        for (int x = 0; x < samples; ++x) {
            ivec2 here = corner + ivec2(x, y);
            is_covered = depth_at(here) < 1.0;
            float dark = light * rim(here, distance_at(here), is_covered ? 2 : 0);
            vec4 line = texelFetch(lines, here, 0);
            vec4 face = texelFetch(lit, here, 0);
            front = min(front, face.a);
            sum += face.rgb * (is_covered ? dark : 1.0) * (1.0 - line.a) + line.rgb;
        }
    }
    fragment = vec4(sum / float(samples * samples), front);
}
