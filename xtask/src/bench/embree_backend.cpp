// The Embree program of `bench accelerators`: Embree 3 or 4 on a mesh and its rays.
//
//   embree_backend_lines FOLDER MESH QUALITY    QUALITY: LOW, MEDIUM, HIGH
//
// Prints "ready VERSION BUILD_SECONDS BYTES", then answers each line "SET STRIDE" with
// "SECONDS HITS": the time of one pass over every STRIDE-th block of 256 rays, with one call per ray.
// Times are processor time.
#include <cmath>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <map>
#include <pmmintrin.h>
#include <string>
#include <unistd.h>
#include <vector>
#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

static long long bytes;
static bool count(void *, ssize_t change, bool) { bytes += change; return true; }

static double seconds() {
    timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

template <class T> static std::vector<T> read(FILE *file, size_t n) {
    std::vector<T> values(n);
    if (fread(values.data(), sizeof(T), n, file) != n) { fprintf(stderr, "file too short\n"); exit(1); }
    return values;
}

static FILE *open(const std::string &path) {
    FILE *file = fopen(path.c_str(), "rb");
    if (!file) { perror(path.c_str()); exit(1); }
    read<char>(file, 4);
    return file;
}

struct Ray { float o[3], min, d[3], max; };

static void set(RTCRay &r, const Ray &ray) {
    r.org_x = ray.o[0]; r.org_y = ray.o[1]; r.org_z = ray.o[2]; r.tnear = ray.min;
    r.dir_x = ray.d[0]; r.dir_y = ray.d[1]; r.dir_z = ray.d[2]; r.tfar = ray.max;
    r.time = 0; r.mask = -1; r.id = 0; r.flags = 0;
}

int main(int argc, char **argv) {
    if (argc != 4) return 2;
    _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
    _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
    std::string base = std::string(argv[1]) + "/" + argv[2], quality = argv[3];
    FILE *file = open(base + ".tri");
    auto sizes = read<unsigned>(file, 2);
    auto vertices = read<float>(file, 3 * (size_t)sizes[0]);
    auto triangles = read<unsigned>(file, 3 * (size_t)sizes[1]);
    fclose(file);
    vertices.resize(vertices.size() + 4);

    RTCDevice device = rtcNewDevice("threads=1");
    rtcSetDeviceMemoryMonitorFunction(device, count, nullptr);
    auto q = quality == "LOW" ? RTC_BUILD_QUALITY_LOW : quality == "MEDIUM" ? RTC_BUILD_QUALITY_MEDIUM : RTC_BUILD_QUALITY_HIGH;
    double build = INFINITY, together = 0;
    RTCScene scene = nullptr;
    for (int i = 0; i < 3 || together < 0.25; i++) {
        if (scene) rtcReleaseScene(scene);
        bytes = 0;
        scene = rtcNewScene(device);
        rtcSetSceneBuildQuality(scene, q);
        RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
        rtcSetGeometryBuildQuality(geometry, q);
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, vertices.data(), 0, 12, sizes[0]);
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, triangles.data(), 0, 12, sizes[1]);
        rtcCommitGeometry(geometry);
        rtcAttachGeometry(scene, geometry);
        rtcReleaseGeometry(geometry);
        double start = seconds();
        rtcCommitScene(scene);
        double took = seconds() - start;
        build = fmin(build, took);
        together += took;
    }
    printf("ready %s %.6f %lld\n", RTC_VERSION_STRING, build, bytes);
    fflush(stdout);

    std::map<std::string, std::vector<Ray>> sets;
    char line[256], name[128];
    int stride;
    while (fgets(line, sizeof line, stdin) && sscanf(line, "%127s %d", name, &stride) == 2) {
        auto &rays = sets[name];
        if (rays.empty()) {
            FILE *file = open(base + "_" + name + ".rays");
            rays = read<Ray>(file, read<unsigned>(file, 1)[0]);
            fclose(file);
        }
        bool any = !strcmp(name, "shadow"), coherent = strcmp(name, "bounce");
#if RTC_VERSION_MAJOR >= 4
        RTCIntersectArguments closest; rtcInitIntersectArguments(&closest);
        RTCOccludedArguments occluded; rtcInitOccludedArguments(&occluded);
        closest.flags = occluded.flags = coherent ? RTC_RAY_QUERY_FLAG_COHERENT : RTC_RAY_QUERY_FLAG_INCOHERENT;
#else
        RTCIntersectContext context; rtcInitIntersectContext(&context);
        context.flags = coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
#endif
        size_t hits = 0;
        double start = seconds();
        for (size_t block = 0; block < rays.size(); block += 256 * (size_t)stride)
            for (size_t i = block; i < rays.size() && i < block + 256; i++) {
                RTCRayHit h;
                set(h.ray, rays[i]);
                h.hit.geomID = h.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
#if RTC_VERSION_MAJOR >= 4
                if (any) rtcOccluded1(scene, &h.ray, &occluded); else rtcIntersect1(scene, &h, &closest);
#else
                if (any) rtcOccluded1(scene, &context, &h.ray); else rtcIntersect1(scene, &context, &h);
#endif
                hits += any ? h.ray.tfar < 0 : h.hit.geomID != RTC_INVALID_GEOMETRY_ID;
            }
        printf("%.9f %zu\n", seconds() - start, hits);
        fflush(stdout);
    }
}
