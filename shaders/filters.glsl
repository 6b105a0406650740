// The filters of Sec. 2.1.1 on a point of a face, as glvis/visibility/filters.py has them: included by
// id_buffer and ask. The paper's own CropBack is not here: its maps are made in NumPy. Depths are along
// the optical axis of the window, or whatever the working range measures; lengths in scene units.
// height:   of the optical centre above the face's plane, negative behind it
// axis_cos: cosine between the face's normal and the way back along the optical axis
bool crop_far(float depth, float max_distance) {
    return depth <= max_distance;
}

// at: where the point is in an image of some size, counted from a corner; depth is above 0.
bool crop_fov(vec2 at, vec2 size, float depth, float max_distance) {
    bool inside = all(greaterThanEqual(at, vec2(0.0))) && all(lessThanEqual(at, size));
    return inside && crop_far(depth, max_distance);
}

bool crop_back(float height) {
    return height > 0.0;
}

// Of faces that CropBack keeps; distance_squared is that of the point from the optical centre.
bool crop_norm_by_ray(float height, float distance_squared, float min_ray_cos) {
    return height * height >= min_ray_cos * min_ray_cos * distance_squared;
}

bool crop_norm_by_axis(float axis_cos, float min_axis_cos) {
    return axis_cos >= min_axis_cos;
}

bool crop_near(float depth, float min_distance) {
    return depth >= min_distance;
}
