// The yardstick's scene in scalar C++: tracer image|gradient OUT
//
// Writes the picture to OUT as float32. Prints the milliseconds of the second of two calls, and the
// peak memory in KB. With `gradient` it prints the derivatives of the loss (mean of squares) and of
// the image's sum by all 24 numbers as well, in forward mode.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

constexpr int N = 24, SIZE = 512, DEPTH = 5, SPHERES = 3, PLANES = 5, NONE = -1, THREADS = 2;
constexpr float FAR = 1e30f;

// A number and its derivatives
struct Dual {
    float v, d[N];
    Dual(float value = 0) : v(value) { std::fill(d, d + N, 0.f); }
};

template <class F> Dual each(float v, F f) {
    Dual r;
    r.v = v;
    for (int i = 0; i < N; i++) r.d[i] = f(i);
    return r;
}
Dual operator+(const Dual &a, const Dual &b) {
    return each(a.v + b.v, [&](int i) { return a.d[i] + b.d[i]; });
}
Dual operator-(const Dual &a, const Dual &b) {
    return each(a.v - b.v, [&](int i) { return a.d[i] - b.d[i]; });
}
Dual operator*(const Dual &a, const Dual &b) {
    return each(a.v * b.v, [&](int i) { return a.d[i] * b.v + a.v * b.d[i]; });
}
Dual operator/(const Dual &a, const Dual &b) {
    float inverse = 1 / b.v, v = a.v * inverse;
    return each(v, [&](int i) { return (a.d[i] - v * b.d[i]) * inverse; });
}
Dual operator*(const Dual &a, float b) { return each(a.v * b, [&](int i) { return a.d[i] * b; }); }
Dual operator*(float a, const Dual &b) { return b * a; }
Dual operator-(const Dual &a) { return a * -1.f; }
Dual chain(const Dual &a, float v, float slope) {
    return each(v, [&](int i) { return slope * a.d[i]; });
}
Dual root(const Dual &a) { float s = std::sqrt(a.v); return chain(a, s, .5f / s); }
Dual power(const Dual &a, float e) {
    float p = std::pow(a.v, e - 1);
    return chain(a, p * a.v, e * p);
}
float root(float a) { return std::sqrt(a); }
float power(float a, float e) { return std::pow(a, e); }
float value(float a) { return a; }
float value(const Dual &a) { return a.v; }

template <class T> struct Vec { T x, y, z; };
template <class T> Vec<T> operator+(const Vec<T> &a, const Vec<T> &b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class T> Vec<T> operator-(const Vec<T> &a, const Vec<T> &b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class T> Vec<T> operator-(const Vec<T> &a) { return {-a.x, -a.y, -a.z}; }
template <class T, class U> Vec<T> operator*(const Vec<T> &a, const U &s) {
    return {a.x * s, a.y * s, a.z * s};
}
template <class T> Vec<T> operator*(const Vec<T> &a, const Vec<T> &b) {
    return {a.x * b.x, a.y * b.y, a.z * b.z};
}
template <class T> T dot(const Vec<T> &a, const Vec<T> &b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class T> Vec<T> unit(const Vec<T> &a) { return a * (T(1) / root(dot(a, a))); }
template <class T> Vec<T> cross(const Vec<T> &a, const Vec<T> &b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template <class T> Vec<float> value(const Vec<T> &a) {
    return {value(a.x), value(a.y), value(a.z)};
}
template <class T> Vec<T> lift(const Vec<float> &a) { return {T(a.x), T(a.y), T(a.z)}; }

// Centre and radius of each sphere, the three indices, the light's position and intensity, and the
// camera's position
const float START[N] = {-.45f, -.6f, .2f, .4f, .45f, -.65f, -.2f, .35f, .1f, -.8f, -.7f, .2f,
                        1.5f, 1.5f, 1.5f, 0, .9f, -.3f, 1, 1, 1, 0, 0, -3.2f};
const Vec<float> NORMAL[PLANES] = {{0, 1, 0}, {0, -1, 0}, {1, 0, 0}, {-1, 0, 0}, {0, 0, -1}};
const Vec<float> COLOR[SPHERES + PLANES] = {
    {.1f, .1f, .1f}, {0, 0, 0},       {.2f, .7f, .3f}, {.7f, .7f, .7f},
    {.7f, .7f, .7f}, {.7f, .2f, .2f}, {.2f, .2f, .7f}, {.7f, .7f, .7f}};
const float REFLECTION[SPHERES] = {.9f, .1f, 0}, REFRACTION[SPHERES] = {0, .9f, 0};
const float SPECULAR = .3f, SHININESS = 50;

template <class T> struct Scene {
    Vec<T> center[SPHERES];
    T radius[SPHERES], ior[SPHERES];
    Vec<T> light, intensity, camera, right, up, forward;

    explicit Scene(const T *p) {
        for (int k = 0; k < SPHERES; k++) {
            center[k] = {p[4 * k], p[4 * k + 1], p[4 * k + 2]};
            radius[k] = p[4 * k + 3];
            ior[k] = p[12 + k];
        }
        light = {p[15], p[16], p[17]};
        intensity = {p[18], p[19], p[20]};
        camera = {p[21], p[22], p[23]};
        forward = unit(-camera);
        right = unit(cross(forward, lift<T>({0, 1, 0})));
        up = cross(right, forward);
    }
};
using Flat = Scene<float>;

// Where a ray starts: on which primitive, and whether into it
struct Source { int index; bool inward; };

// Along a ray to a sphere; FAR if there is nothing in front
float distance(const Flat &s, int k, const Vec<float> &o, const Vec<float> &d, Source from) {
    if (from.index == k && !from.inward) return FAR;
    Vec<float> oc = o - s.center[k];
    float b = dot(oc, d);
    Vec<float> q = oc - d * b;
    float disc = s.radius[k] * s.radius[k] - dot(q, q);
    if (disc <= 0) return FAR;
    float h = std::sqrt(disc), t = from.index == k || -b - h <= 0 ? -b + h : -b - h;
    return t > 0 ? t : FAR;
}

int closest(const Flat &s, const Vec<float> &o, const Vec<float> &d, Source from) {
    float best = FAR;
    int index = NONE;
    for (int k = 0; k < SPHERES + PLANES; k++) {
        float t = FAR;
        if (k < SPHERES) t = distance(s, k, o, d, from);
        else if (from.index != k)
            t = -(dot(o, NORMAL[k - SPHERES]) + 1) / dot(d, NORMAL[k - SPHERES]);
        if (t > 0 && t < best) best = t, index = k;
    }
    return index;
}

// Planes bound a convex room with the light in it and throw no shadows
bool occluded(const Flat &s, const Vec<float> &p, const Vec<float> &l, float far, Source from) {
    for (int k = 0; k < SPHERES; k++)
        if (distance(s, k, p, l, from) < far) return true;
    return false;
}

template <class T>
Vec<T> radiance(const Scene<T> &s, const Flat &flat, const Vec<T> &o, const Vec<T> &d, Source from,
                int depth) {
    int index = closest(flat, value(o), value(d), from);
    if (index == NONE) return lift<T>({0, 0, 0});
    bool ball = index < SPHERES;
    T t;
    if (ball) {
        Vec<T> oc = o - s.center[index];
        T b = dot(oc, d);
        Vec<T> q = oc - d * b;
        T h = root(s.radius[index] * s.radius[index] - dot(q, q));
        t = from.index == index || value(-b - h) <= 0 ? h - b : -b - h;
    } else {
        Vec<T> m = lift<T>(NORMAL[index - SPHERES]);
        t = -(dot(o, m) + T(1)) / dot(d, m);
    }
    Vec<T> p = o + d * t;
    Vec<T> n = ball ? (p - s.center[index]) * (T(1) / s.radius[index])
                    : lift<T>(NORMAL[index - SPHERES]);
    bool inside = value(dot(n, d)) > 0;
    if (inside) n = -n;

    Vec<T> result = lift<T>({0, 0, 0}), to = s.light - p;
    T far = root(dot(to, to));
    Vec<T> l = to * (T(1) / far);
    T lambert = dot(n, l);
    if (value(lambert) > 0 && !occluded(flat, value(p), value(l), value(far), {index, inside})) {
        T shine = dot(n, unit(l - d));
        T spot = value(shine) > 0 ? power(shine, SHININESS) * SPECULAR : T(0);
        const Vec<float> &c = COLOR[index];
        Vec<T> reflected = {lambert * c.x + spot, lambert * c.y + spot, lambert * c.z + spot};
        result = s.intensity * reflected;
    }
    if (depth == DEPTH || !ball) return result;

    T c = -dot(d, n), eta = inside ? s.ior[index] : T(1) / s.ior[index];
    T k = T(1) - eta * eta * (T(1) - c * c);
    float reflection = REFLECTION[index], refraction = REFRACTION[index];
    if (refraction > 0 && value(k) <= 0) reflection += refraction, refraction = 0;
    if (reflection > 0) {
        Vec<T> mirrored = d + n * (c * 2.f);
        result = result + radiance(s, flat, p, mirrored, {index, inside}, depth + 1) * reflection;
    }
    if (refraction > 0) {
        Vec<T> bent = d * eta + n * (eta * c - root(k));
        result = result + radiance(s, flat, p, bent, {index, !inside}, depth + 1) * refraction;
    }
    return result;
}

// Derivatives of the loss and of the sum
struct Totals { double loss[N] = {}, sum[N] = {}; };

void add(Totals &, const Vec<float> &) {}
void add(Totals &totals, const Vec<Dual> &pixel) {
    for (const Dual *a : {&pixel.x, &pixel.y, &pixel.z})
        for (int i = 0; i < N; i++) {
            totals.loss[i] += 2 * a->v * a->d[i] / (3. * SIZE * SIZE);
            totals.sum[i] += a->d[i];
        }
}

template <class T> Totals render(const T *parameters, std::vector<float> &image) {
    Flat flat(START);
    Scene<T> scene(parameters);
    std::atomic<int> next{0};
    Totals totals[THREADS];
    auto work = [&](Totals &mine) {
        float scale = std::tan(53.130102354f * float(M_PI) / 360);
        for (int y; (y = next++) < SIZE;)
            for (int x = 0; x < SIZE; x++) {
                T u = T((2 * (x + .5f) / SIZE - 1) * scale);
                T v = T((1 - 2 * (y + .5f) / SIZE) * scale);
                Vec<T> d = unit(scene.forward + scene.right * u + scene.up * v);
                Vec<T> c = radiance(scene, flat, scene.camera, d, {NONE, false}, 1);
                float *pixel = &image[3 * (y * SIZE + x)];
                pixel[0] = value(c.x), pixel[1] = value(c.y), pixel[2] = value(c.z);
                add(mine, c);
            }
    };
    std::vector<std::thread> threads;
    for (Totals &mine : totals) threads.emplace_back(work, std::ref(mine));
    for (std::thread &thread : threads) thread.join();
    for (int i = 0; i < N; i++) {
        totals[0].loss[i] += totals[1].loss[i];
        totals[0].sum[i] += totals[1].sum[i];
    }
    return totals[0];
}

using Clock = std::chrono::steady_clock;

int main(int, char **arguments) {
    bool gradient = !std::strcmp(arguments[1], "gradient");
    std::vector<float> image(3 * SIZE * SIZE);
    Dual parameters[N];
    for (int i = 0; i < N; i++) parameters[i].v = START[i], parameters[i].d[i] = 1;
    Totals totals;
    for (int turn = 0; turn < 2; turn++) {
        auto start = Clock::now();
        totals = gradient ? render(parameters, image) : render(START, image);
        std::chrono::duration<double, std::milli> taken = Clock::now() - start;
        if (turn) std::printf("ms %f\n", taken.count());
    }
    std::ofstream file(arguments[2], std::ios::binary);
    file.write(reinterpret_cast<char *>(image.data()), image.size() * sizeof(float));
    file.close();
    std::ifstream status("/proc/self/status");
    for (std::string line; std::getline(status, line);)
        if (line.rfind("VmHWM:", 0) == 0) std::printf("memory %s\n", line.c_str() + 6);
    for (auto [name, values] : {std::pair{"loss", totals.loss}, std::pair{"sum", totals.sum}}) {
        std::printf("%s", name);
        for (int i = 0; gradient && i < N; i++) std::printf(" %.9g", values[i]);
        std::printf("\n");
    }
}
