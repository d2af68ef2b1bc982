// Sixteen floats at a time: one AVX-512 register, two AVX2 registers, or an array that the compiler
// vectorises for whatever is there. Every operation rounds as the scalar one does (no fused
// multiply-add), so all instruction sets give the same bits.
//
// To be included inside the namespace of one instruction set, after PTN_SIMD is set.

struct F16;
using Mask = uint32_t;  // bit i: lane i

#if PTN_SIMD > 0
inline float largest(__m128 q) {
  q = _mm_max_ps(q, _mm_movehl_ps(q, q));
  return _mm_cvtss_f32(_mm_max_ss(q, _mm_movehdup_ps(q)));
}
#endif

#if PTN_SIMD == 512

struct F16 {
  __m512 v;
};
inline F16 load(const float* p) { return {_mm512_load_ps(p)}; }
inline void store(float* p, F16 a) { _mm512_store_ps(p, a.v); }
inline F16 all(float s) { return {_mm512_set1_ps(s)}; }
inline F16 operator+(F16 a, F16 b) { return {_mm512_add_ps(a.v, b.v)}; }
inline F16 operator-(F16 a, F16 b) { return {_mm512_sub_ps(a.v, b.v)}; }
inline F16 operator*(F16 a, F16 b) { return {_mm512_mul_ps(a.v, b.v)}; }
inline F16 min(F16 a, F16 b) { return {_mm512_min_ps(a.v, b.v)}; }
inline F16 max(F16 a, F16 b) { return {_mm512_max_ps(a.v, b.v)}; }
inline Mask operator<(F16 a, F16 b) { return _mm512_cmp_ps_mask(a.v, b.v, _CMP_LT_OQ); }
inline Mask operator<=(F16 a, F16 b) { return _mm512_cmp_ps_mask(a.v, b.v, _CMP_LE_OQ); }
inline Mask operator==(F16 a, F16 b) { return _mm512_cmp_ps_mask(a.v, b.v, _CMP_EQ_OQ); }
inline float largest(F16 a) {
  const __m256 m = _mm256_max_ps(_mm512_maskz_extractf32x8_ps(255, a.v, 0),
                                 _mm512_maskz_extractf32x8_ps(255, a.v, 1));
  return largest(_mm_max_ps(_mm256_castps256_ps128(m), _mm256_extractf128_ps(m, 1)));
}

#elif PTN_SIMD == 256

struct F16 {
  __m256 a, b;
};
inline F16 load(const float* p) { return {_mm256_load_ps(p), _mm256_load_ps(p + 8)}; }
inline void store(float* p, F16 x) {
  _mm256_store_ps(p, x.a);
  _mm256_store_ps(p + 8, x.b);
}
inline F16 all(float s) { return {_mm256_set1_ps(s), _mm256_set1_ps(s)}; }
inline F16 operator+(F16 x, F16 y) { return {_mm256_add_ps(x.a, y.a), _mm256_add_ps(x.b, y.b)}; }
inline F16 operator-(F16 x, F16 y) { return {_mm256_sub_ps(x.a, y.a), _mm256_sub_ps(x.b, y.b)}; }
inline F16 operator*(F16 x, F16 y) { return {_mm256_mul_ps(x.a, y.a), _mm256_mul_ps(x.b, y.b)}; }
inline F16 min(F16 x, F16 y) { return {_mm256_min_ps(x.a, y.a), _mm256_min_ps(x.b, y.b)}; }
inline F16 max(F16 x, F16 y) { return {_mm256_max_ps(x.a, y.a), _mm256_max_ps(x.b, y.b)}; }
inline Mask bits(__m256 a, __m256 b) {
  return static_cast<Mask>(_mm256_movemask_ps(a)) | static_cast<Mask>(_mm256_movemask_ps(b)) << 8;
}
inline Mask operator<(F16 x, F16 y) {
  return bits(_mm256_cmp_ps(x.a, y.a, _CMP_LT_OQ), _mm256_cmp_ps(x.b, y.b, _CMP_LT_OQ));
}
inline Mask operator<=(F16 x, F16 y) {
  return bits(_mm256_cmp_ps(x.a, y.a, _CMP_LE_OQ), _mm256_cmp_ps(x.b, y.b, _CMP_LE_OQ));
}
inline Mask operator==(F16 x, F16 y) {
  return bits(_mm256_cmp_ps(x.a, y.a, _CMP_EQ_OQ), _mm256_cmp_ps(x.b, y.b, _CMP_EQ_OQ));
}
inline float largest(F16 x) {
  const __m256 m = _mm256_max_ps(x.a, x.b);
  return largest(_mm_max_ps(_mm256_castps256_ps128(m), _mm256_extractf128_ps(m, 1)));
}

#else

struct alignas(64) F16 {
  float v[16];
};
// Applies an expression of lane i to every lane.
# define PTN_LANES(result, expression) \
   for (int i = 0; i < 16; ++i) result = (expression)
inline F16 load(const float* p) {
  F16 r;
  PTN_LANES(r.v[i], p[i]);
  return r;
}
inline void store(float* p, F16 a) { PTN_LANES(p[i], a.v[i]); }
inline F16 all(float s) {
  F16 r;
  PTN_LANES(r.v[i], s);
  return r;
}
# define PTN_BINARY(name, expression) \
   inline F16 name(F16 a, F16 b) {    \
     F16 r;                           \
     PTN_LANES(r.v[i], expression);   \
     return r;                        \
   }
PTN_BINARY(operator+, a.v[i] + b.v[i])
PTN_BINARY(operator-, a.v[i] - b.v[i])
PTN_BINARY(operator*, a.v[i] * b.v[i])
PTN_BINARY(min, a.v[i] < b.v[i] ? a.v[i] : b.v[i])
PTN_BINARY(max, a.v[i] > b.v[i] ? a.v[i] : b.v[i])
# define PTN_COMPARE(op)                                         \
   inline Mask operator op(F16 a, F16 b) {                       \
     Mask r = 0;                                                 \
     PTN_LANES(r, r | static_cast<Mask>(a.v[i] op b.v[i]) << i); \
     return r;                                                   \
   }
PTN_COMPARE(<)
PTN_COMPARE(<=)
PTN_COMPARE(==)
inline float largest(F16 a) {
  for (int step = 8; step > 0; step /= 2) {
    for (int i = 0; i < step; ++i) a.v[i] = a.v[i] > a.v[i + step] ? a.v[i] : a.v[i + step];
  }
  return a.v[0];
}
# undef PTN_LANES
# undef PTN_BINARY
# undef PTN_COMPARE

#endif

// Calls f(lane) for each set bit, lowest first.
template <class F>
inline void for_each_lane(Mask mask, F&& f) {
  for (; mask != 0; mask &= mask - 1) f(__builtin_ctz(mask));
}

struct Query {
  F16 x, y, z;
  explicit Query(const float* p) : x(all(p[0])), y(all(p[1])), z(all(p[2])) {}
};

// Squared distances in float32, summed as (x + y) + z: the one formula of all ops.
inline F16 squared(F16 dx, F16 dy, F16 dz) { return (dx * dx + dy * dy) + dz * dz; }
