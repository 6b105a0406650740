// The lens of a viewpoint, as glvis/problem/lens.py and calibrated_lens.py have it: which directions
// of the camera frame are in the image, and what the working range measures. Included by ask where
// LENS is defined; without it the window is the image, and the range is depth.
layout(std140, binding = 1) uniform Lens {
    vec4 image;             // focal lengths and centre, shares of the image's width and height;
                            // spherical: range of azimuth, lowest and highest elevation, radians
    vec4 coefficients[2];   // opencv: k1 k2 p1 p2, k3 k4 k5 k6; fisheye: k1 k2 k3 k4
    float end;              // tangent (opencv) or angle (fisheye) at which the lens ends
    int kind;
    int by_range;           // whether minD and maxD are distances from the optical centre
};

const int PINHOLE = 0, OPENCV = 1, FISHEYE = 2, SPHERICAL = 3;
const float FULL_TURN = 6.28318;    // a little less than 2 pi: beyond it no azimuth is outside

// Of distorted tangents, y up.
bool is_within(vec2 tangent) {
    vec2 at = vec2(image.x * tangent.x + image.z, image.w - image.y * tangent.y);
    return all(greaterThanEqual(at, vec2(0.0))) && all(lessThanEqual(at, vec2(1.0)));
}

// direction: x right, y up, and depth along the optical axis, of any length.
bool in_image(vec3 direction) {
    vec4 a = coefficients[0], b = coefficients[1];
    if (kind == OPENCV) {
        vec2 t = direction.xy / direction.z;
        float s = dot(t, t);
        if (!(direction.z > 0.0) || !(s < end * end)) return false;
        float radial = (1.0 + s * (a.x + s * (a.y + s * b.x)))
            / (1.0 + s * (b.y + s * (b.z + s * b.w)));
        // OpenCV's y points down
        vec2 tangential = vec2(
            -2.0 * a.z * t.x * t.y + a.w * (s + 2.0 * t.x * t.x),
            -a.z * (s + 2.0 * t.y * t.y) + 2.0 * a.w * t.x * t.y
        );
        return is_within(t * radial + tangential);
    }
    if (kind == FISHEYE) {
        float aside = length(direction.xy), theta = atan(aside, direction.z), s = theta * theta;
        float radius = theta * (1.0 + s * (a.x + s * (a.y + s * (a.z + s * a.w))));
        return theta < end && is_within(aside > 0.0 ? direction.xy * (radius / aside) : vec2(0.0));
    }
    if (kind == SPHERICAL) {
        float elevation = atan(direction.y, length(direction.xz));
        bool is_level = elevation >= image.y && elevation <= image.z;
        return is_level && (image.x > FULL_TURN
            || abs(atan(direction.x, direction.z)) <= 0.5 * image.x);
    }
    return true;
}

// What is compared with minD and maxD.
float measured(vec3 direction) {
    return by_range != 0 ? length(direction) : direction.z;
}
