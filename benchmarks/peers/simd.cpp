// The yardstick's scene by hand: packets of rays, as wide as a register, in two threads.
//
// One source for AVX2 and AVX-512: `std::experimental::simd` is as wide as -march says. All numbers
// of the scene are data. Masks are of lanes; whatever no lane of a packet needs is branched around.
#include <atomic>
#include <bit>
#include <cstring>
#include <experimental/simd>
#include <immintrin.h>
#include <thread>

namespace simd = std::experimental;
using V = simd::native_simd<float>;
using M = V::mask_type;
using I = simd::rebind_simd_t<int, V>;
constexpr int LANES = V::size(), WIDE = 4, HIGH = LANES / WIDE;
constexpr int SIZE = 512, DEPTH = 5, SPHERES = 3, PLANES = 5;
constexpr float FAR = 1e30f, NONE = -1;
#define INLINE inline __attribute__((always_inline))

namespace {

template <class T> struct Vec { T x, y, z; };
using Three = Vec<float>;
using Lanes = Vec<V>;

template <class T, class U> INLINE auto operator+(const Vec<T> &a, const Vec<U> &b) {
    return Vec<decltype(a.x + b.x)>{a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class T, class U> INLINE auto operator-(const Vec<T> &a, const Vec<U> &b) {
    return Vec<decltype(a.x - b.x)>{a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class T, class U> INLINE auto operator*(const Vec<T> &a, const U &s) {
    return Vec<decltype(a.x * s)>{a.x * s, a.y * s, a.z * s};
}
template <class T, class U> INLINE auto dot(const Vec<T> &a, const Vec<U> &b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class T> INLINE void put(const M &where, Lanes &to, const Vec<T> &from) {
    simd::where(where, to.x) = from.x;
    simd::where(where, to.y) = from.y;
    simd::where(where, to.z) = from.z;
}

// 1 / sqrt(a): the processor's guess and a step of Newton's method
INLINE V inverse_root(const V &a) {
#ifdef __AVX512F__
    V y(_mm512_rsqrt14_ps(static_cast<__m512>(a)));
#else
    V y(_mm256_rsqrt_ps(static_cast<__m256>(a)));
#endif
    return y * (1.5f - .5f * a * y * y);
}

// The scene as peers/simd_peer.py lays it out
struct Material { Three color; float specular, shininess, reflection, refraction, ior; };
struct Sphere { Three center; float radius; Material material; };
struct Plane { Three normal; float offset; Material material; };
struct Scene {
    Three camera, forward, right, up, light, intensity;
    Sphere spheres[SPHERES];
    Plane planes[PLANES];
};

// base^exponent for base > 0: polynomials of log2 and exp2, both within 2e-7 of their value
INLINE V power(const V &base, const V &exponent) {
    I bits = std::bit_cast<I>(base), whole = (bits - 0x3f3504f3) >> 23;
    V m = std::bit_cast<V>(bits - (whole << 23)) - 1.f;
    V m2 = m * m, m4 = m2 * m2;
    V log = ((-.14620353f * m + .23420985f) * m2 + (-.24882181f * m + .28707561f)) * m4 +
            ((-.36024199f * m + .48092404f) * m2 + (-.72135276f * m + 1.44269496f));
    V y = exponent * (log * m + simd::static_simd_cast<V>(whole));
    y = simd::max(y, V(-126.f));
    V near = simd::nearbyint(y), x = y - near, x2 = x * x;
    V exp = ((.00134004f * x + .00967604f) * x2 + (.05550327f * x + .24022107f)) * x2 +
            (.69314721f * x + 1);
    return std::bit_cast<V>(std::bit_cast<I>(exp) + (simd::static_simd_cast<I>(near) << 23));
}

// Narrow `hits` to the lanes whose ray meets a sphere nearer than `t`, and give its distance.
// `on` are the rays that start on the sphere, `inward` those that start into what they are on.
INLINE bool meets(const Sphere &s, const Lanes &to, const Lanes &d, const M &on, const M &inward,
                  const V &t, M &hits, V &distance) {
    V b = dot(to, d);
    Lanes q = to - d * b;
    V inside = s.radius * s.radius - dot(q, q);
    hits = hits && inside > 0 && (!on || inward);
    if (none_of(hits)) return false;
    V half = sqrt(inside);
    distance = b - half;
    simd::where(on || distance <= 0, distance) = b + half;
    hits = hits && distance > 0 && distance < t;
    return true;
}

// Planes throw no shadows: none is between the light and the eye, and what is seen is on their side
INLINE M occluded(const Scene &s, const Lanes &p, const Lanes &l, const V &far, const V &index,
                  const M &inside, M open) {
    M blocked(false);
    for (int k = 0; k < SPHERES; k++) {
        const Sphere &sphere = s.spheres[k];
        M hits = open;
        V distance;
        if (meets(sphere, sphere.center - p, l, index == k, inside, far, hits, distance))
            blocked = blocked || hits;
    }
    return blocked;
}

// The nearest shape that each ray meets, or NONE, and its distance
INLINE void closest(const Scene &s, const Lanes &o, const Lanes &d, const V &source,
                    const M &inward, const M &active, V &t, V &index) {
    // No ray starts on a plane, as none reflects. The nearest is kept as a fraction, so that all
    // planes share one division
    V above = 1, below = 1 / FAR;
    index = NONE;
    for (int k = 0; k < PLANES; k++) {
        const Plane &plane = s.planes[k];
        V height = -dot(o, plane.normal) - plane.offset, slope = dot(d, plane.normal);
        M hits = height * slope > 0 && abs(height) * below < above * abs(slope);
        simd::where(hits, above) = abs(height);
        simd::where(hits, below) = abs(slope);
        simd::where(hits, index) = SPHERES + k;
    }
    t = above / below;
    for (int k = 0; k < SPHERES; k++) {
        const Sphere &sphere = s.spheres[k];
        M hits = active;
        V distance;
        if (meets(sphere, sphere.center - o, d, source == k, inward, t, hits, distance)) {
            simd::where(hits, t) = distance;
            simd::where(hits, index) = k;
        }
    }
}

// The light that rays bring back. They start on the shape `source`, and go into it or not
template <int depth>
Lanes trace(const Scene &s, const Lanes &o, const Lanes &d, const V &source, const M &inward,
            const M &active) {
    V t, index;
    closest(s, o, d, source, inward, active, t, index);
    M hit = active && index >= 0;
    Lanes p = o + d * t, n{}, color{};
    V specular = 0, shininess = 1, reflection = 0, refraction = 0, ior = 1;
    auto surface = [&](const M &here, const Material &m) __attribute__((always_inline)) {
        put(here, color, m.color);
        simd::where(here, specular) = m.specular;
        simd::where(here, shininess) = m.shininess;
    };
    for (int k = 0; k < SPHERES; k++) {
        M here = hit && index == k;
        if (none_of(here)) continue;
        const Material &m = s.spheres[k].material;
        put(here, n, (p - s.spheres[k].center) * (1 / s.spheres[k].radius));
        surface(here, m);
        simd::where(here, reflection) = m.reflection;
        simd::where(here, refraction) = m.refraction;
        simd::where(here, ior) = m.ior;
    }
    for (int k = 0; k < PLANES; k++) {
        M here = hit && index == SPHERES + k;
        if (none_of(here)) continue;
        put(here, n, s.planes[k].normal);
        surface(here, s.planes[k].material);
    }
    V cosine = -dot(n, d);
    M inside = cosine < 0;
    put(inside, n, n * -1.f);
    cosine = abs(cosine);

    Lanes result{}, to = s.light - p;
    V squared = dot(to, to), inverse = inverse_root(squared), far = squared * inverse;
    Lanes l = to * inverse;
    V lambert = dot(n, l);
    M lit = hit && lambert > 0;
    if (any_of(lit)) {
        lit = lit && !occluded(s, p, l, far, index, inside, lit);
        // The half vector is l - d, whose square is 2 - 2 l.d
        V shine = (lambert + cosine) * inverse_root(2 - 2 * dot(l, d));
        V spot = specular * power(shine, shininess);
        put(lit, result, Lanes{s.intensity.x * (color.x * lambert + spot),
                               s.intensity.y * (color.y * lambert + spot),
                               s.intensity.z * (color.z * lambert + spot)});
    }
    if constexpr (depth < DEPTH) {
        if (none_of(reflection + refraction > 0)) return result;
        V eta = 1 / ior;
        simd::where(inside, eta) = ior;
        V k = 1 - eta * eta * (1 - cosine * cosine);
        M total = k <= 0;
        simd::where(total, reflection) = reflection + refraction;
        simd::where(total, refraction) = 0;
        M mirrored = reflection > 0, bent = refraction > 0;
        if (any_of(mirrored)) {
            Lanes way = d + n * (2 * cosine);
            result = result + trace<depth + 1>(s, p, way, index, inside, mirrored) * reflection;
        }
        if (any_of(bent)) {
            Lanes way = d * eta + n * (eta * cosine - sqrt(k));
            result = result + trace<depth + 1>(s, p, way, index, !inside, bent) * refraction;
        }
    }
    return result;
}

// A row of blocks, HIGH rows of pixels: colours lie apart first, and are woven at the end
INLINE void strip(const Scene &s, int top, float *picture) {
    float red[HIGH][SIZE], green[HIGH][SIZE], blue[HIGH][SIZE];
    V row([&](int lane) { return top + lane / WIDE + .5f; });
    Lanes high = s.forward + s.up * (1 - row * (2.f / SIZE));
    for (int left = 0; left < SIZE; left += WIDE) {
        V column([&](int lane) { return left + lane % WIDE + .5f; });
        Lanes d = high + s.right * (column * (2.f / SIZE) - 1);
        d = d * inverse_root(dot(d, d));
        V zero = 0;
        Lanes o{zero + s.camera.x, zero + s.camera.y, zero + s.camera.z};
        Lanes c = trace<1>(s, o, d, V(NONE), M(false), M(true));
        float r[LANES], g[LANES], b[LANES];
        c.x.copy_to(r, simd::element_aligned);
        c.y.copy_to(g, simd::element_aligned);
        c.z.copy_to(b, simd::element_aligned);
        for (int y = 0; y < HIGH; y++) {
            std::memcpy(&red[y][left], r + y * WIDE, WIDE * sizeof(float));
            std::memcpy(&green[y][left], g + y * WIDE, WIDE * sizeof(float));
            std::memcpy(&blue[y][left], b + y * WIDE, WIDE * sizeof(float));
        }
    }
    for (int y = 0; y < HIGH; y++) {
        float *__restrict pixel = picture + 3 * (top + y) * SIZE;
        for (int x = 0; x < SIZE; x++)
            pixel[3 * x] = red[y][x], pixel[3 * x + 1] = green[y][x], pixel[3 * x + 2] = blue[y][x];
    }
}

} // namespace

extern "C" void render(const Scene *scene, float *picture) {
    std::atomic<int> next{0};
    auto work = [&] {
        for (int top; (top = next.fetch_add(HIGH)) < SIZE;)
            strip(*scene, top, picture);
    };
    std::thread other(work);
    work();
    other.join();
}
