/* Traces one camera's rays through Embree 4 in packets of 16, 4 x 4 pixels each. Built and called by embree.py.
   The declarations below are those parts of Embree's C interface that are used here. */

#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <xmmintrin.h>
#include <pmmintrin.h>

enum { LANES = 16, SIDE = 4, TRIANGLES = 0, INDEX_BUFFER = 0, VERTEX_BUFFER = 1, UINT3 = 0x5003, FLOAT3 = 0x9003 };

struct packet {
    float origin[3][LANES], near[LANES], direction[3][LANES], time[LANES], far[LANES];
    unsigned mask[LANES], number[LANES], flags[LANES];
    float normal[3][LANES], u[LANES], v[LANES];
    unsigned triangle[LANES], geometry[LANES];
    unsigned instances[8][LANES]; /* more room than any build of Embree uses */
} __attribute__((aligned(64)));

struct arguments {
    unsigned flags, features;
    void *context, *filter, *intersect, *unused[4];
};
enum { COHERENT = 1 << 16 };

extern void *rtcNewDevice(const char *settings);
extern void *rtcNewScene(void *device);
extern void *rtcNewGeometry(void *device, int kind);
extern void rtcSetSharedGeometryBuffer(void *geometry, int buffer, unsigned slot, int format, const void *bytes,
                                       size_t offset, size_t stride, size_t count);
extern void rtcCommitGeometry(void *geometry);
extern unsigned rtcAttachGeometry(void *scene, void *geometry);
extern void rtcCommitScene(void *scene);
extern void rtcIntersect16(const int *valid, void *scene, struct packet *packet, struct arguments *arguments);

/* The scene of a mesh; `positions` must end in room for one more float. */
void *prepare(const float *positions, size_t corners, const unsigned *triangles, size_t count) {
    _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
    _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
    void *device = rtcNewDevice("threads=1");
    if (!device) return NULL;
    void *scene = rtcNewScene(device), *geometry = rtcNewGeometry(device, TRIANGLES);
    rtcSetSharedGeometryBuffer(geometry, VERTEX_BUFFER, 0, FLOAT3, positions, 0, 12, corners);
    rtcSetSharedGeometryBuffer(geometry, INDEX_BUFFER, 0, UINT3, triangles, 0, 12, count);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcCommitScene(scene);
    return scene;
}

/* Fills `depth` and `triangle`, side x side each. The camera is eye, right, up, ahead and a tangent. */
void render(void *scene, const float *camera, int side, float *depth, unsigned *triangle) {
    int valid[LANES] __attribute__((aligned(64)));
    struct packet packet;
    struct arguments arguments = {.flags = COHERENT, .features = ~0u};
    const float slope = camera[12] / (0.5f * side);
    for (int lane = 0; lane < LANES; lane++) valid[lane] = -1;
    memset(&packet, 0, sizeof packet);
    for (int tile = 0; tile < (side / SIDE) * (side / SIDE); tile++) {
        const int left = tile % (side / SIDE) * SIDE, top = tile / (side / SIDE) * SIDE;
        for (int lane = 0; lane < LANES; lane++) {
            const float x = (left + lane % SIDE + 0.5f - 0.5f * side) * slope;
            const float y = (top + lane / SIDE + 0.5f - 0.5f * side) * slope;
            for (int axis = 0; axis < 3; axis++) {
                packet.origin[axis][lane] = camera[axis];
                packet.direction[axis][lane] = camera[9 + axis] + x * camera[3 + axis] - y * camera[6 + axis];
            }
            packet.near[lane] = 0;
            packet.far[lane] = INFINITY;
            packet.mask[lane] = ~0u;
            packet.geometry[lane] = ~0u;
        }
        rtcIntersect16(valid, scene, &packet, &arguments);
        for (int lane = 0; lane < LANES; lane++) {
            const int pixel = (top + lane / SIDE) * side + left + lane % SIDE;
            const int hit = packet.geometry[lane] != ~0u;
            depth[pixel] = hit ? packet.far[lane] : 0;
            triangle[pixel] = hit ? packet.triangle[lane] : ~0u;
        }
    }
}
