// What all passes that cast are told of one window of a view and one surface: included by keep, ask
// and hide. A window is a pinhole image about the optical centre; mostly it is the sensor's own.
// The image is a grid of cells, in which points that are asked about are looked up; it has nothing
// to do with pixels. Row 0 is at the bottom.
layout(std140, binding = 0) uniform View {
    mat4 world_to_grid;     // world relative to the origin -> (column, row, 1) * depth, counted from
                            // the image's middle
    vec4 lattice;           // of packed corners: the middle relative to the origin, and the step
    vec4 eye;               // optical centre relative to the origin
    vec4 backwards;         // unit vector against the optical axis; w: least cosine to it, -2: any
    vec4 right;             // unit vectors of the sensor's camera, where LENS is defined
    vec4 up;
    vec2 working_range;     // minD, maxD, scene unit
    float min_ray_cos;      // cosine of the largest incidence by the true ray, or 0: any
    float near;             // depth before which nothing hides
    ivec2 size;             // columns, rows
    int first_row;          // of this view's grid among those of all views
    int first_tile_row;     // the same in tiles
    uint first_listed;      // where this pass's list of clusters begins
    uint n_listed;          // how many it has
    uint first_kept;        // where the list of those that are kept of them begins
    uint first_spread;      // where the list of faces begins that cover many cells; as long
    uint request;           // which group of numbers in Dispatches tells of those kept; the next one
                            // tells of those faces
    uint size_log2;         // faces a cluster
    uint groups_a_column;   // work groups along y
    uint first_record;      // of this view's records: one a face, in the order of the clusters
    uint first_extra;       // of its further ones, 64 a face
    float span;             // a face may be large whose longest edge, times this, is at least its
                            // least depth; 0: none is looked at again
};

const int TILE = 8;                     // cells along a side of a tile
const uint FACES_A_LINE = 2048u;        // of packed_faces and face_centres, as surface.py has them
const uint RECORDS_A_LINE = 2048u;
const uint LARGE = 1u << 31;            // marks faces that may have to be looked at again
const uint LOOKED_UP = 1u << 30;        // and points that a second viewpoint has looked up

ivec2 record_at(uint record) {
    return ivec2(record % RECORDS_A_LINE, record / RECORDS_A_LINE);
}

vec3 in_grid(vec3 position) {
    return (world_to_grid * vec4(position, 1.0)).xyz;
}

// Number of this invocation where work groups lie in y first.
uint invocation() {
    uint group = gl_WorkGroupID.x * gl_NumWorkGroups.y + gl_WorkGroupID.y;
    return group * gl_WorkGroupSize.x + gl_LocalInvocationIndex;
}
