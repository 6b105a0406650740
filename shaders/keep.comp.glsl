#version 430 core
// Keeps those clusters of a list that may hide a point that is asked about: one that lies farther
// away, in a tile of the image that the cluster reaches. It never changes a map. One invocation a
// cluster.
// in:  listed      clusters + 1 in the frustum; those that are kept are written further on
//      boxes       two texels a cluster: middle and half extent of the box around it, relative to
//                  the origin
//      tiles       depth bits of the farthest point that is asked about, by tile; 0 where none is
// out: listed      clusters + 1, one after the other; 0 beyond
//      dispatches  (work groups x, y, z, clusters kept) of each request; y and z are given
layout(local_size_x = 64) in;
#include "view.glsl"
layout(binding = 4) uniform sampler2D boxes;
layout(binding = 5) uniform usampler2D tiles;
layout(std430, binding = 0) buffer Listed { uint listed[]; };
layout(std430, binding = 1) buffer Dispatches { uint dispatches[]; };

const uint CLUSTERS_A_LINE = 1024u;
const float MARGIN = 1e-5;      // share of the distance that float32 may move a boundary

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= n_listed) return;
    uint cluster = listed[first_listed + i] - 1u;
    ivec2 at = ivec2(2u * (cluster % CLUSTERS_A_LINE), cluster / CLUSTERS_A_LINE);
    vec3 box = texelFetch(boxes, at, 0).xyz, h = texelFetch(boxes, at + ivec2(1, 0), 0).xyz;
    vec3 middle = in_grid(box);
    mat3 columns = mat3(world_to_grid);
    // how far it reaches in columns * depth, rows * depth and depth
    vec3 reach = abs(columns[0]) * h.x + abs(columns[1]) * h.y + abs(columns[2]) * h.z;
    vec2 extent = vec2(size);
    reach += MARGIN * vec3(extent, 1.0) * (abs(middle.z) + length(box) + length(eye.xyz));
    vec3 least = middle - reach, most = middle + reach;
    vec2 low = vec2(0.0), high = extent;
    if (least.z > near) {
        low = min(least.xy / least.z, least.xy / most.z) + 0.5 * extent;
        high = max(most.xy / least.z, most.xy / most.z) + 0.5 * extent;
    }
    ivec2 first = ivec2(clamp(low, vec2(0.0), extent - 1.0)) / TILE;
    ivec2 last = ivec2(clamp(high, vec2(0.0), extent - 1.0)) / TILE;
    if (most.z <= near) last.y = first.y - 1;
    uint before = floatBitsToUint(max(least.z, 0.0));
    bool hides = false;
    ivec2 tile = first;
    while (tile.y <= last.y) {
        hides = texelFetch(tiles, tile + ivec2(0, first_tile_row), 0).r > before;
        if (hides) break;
        ++tile.x;
        if (tile.x > last.x) tile = ivec2(first.x, tile.y + 1);
    }
    if (hides) {
        uint place = atomicAdd(dispatches[4u * request + 3u], 1u);
        listed[first_kept + place] = cluster + 1u;
        // one more column of work groups for each so many clusters
        uint column = (gl_WorkGroupSize.x * groups_a_column) >> size_log2;
        if (place % column == 0u) atomicAdd(dispatches[4u * request], 1u);
    }
}
