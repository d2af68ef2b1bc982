// See simd.h. Needs AVX2.
#pragma once

#include "core/isa.h"

namespace ptn::PTN_ISA {

struct F16 {
  __m256 a, b;
};
struct I16 {
  __m256i a, b;
};
struct M16 {
  __m256 a, b;
};

inline F16 load(const float* p) { return {_mm256_load_ps(p), _mm256_load_ps(p + 8)}; }
inline I16 load(const int32_t* p) {
  const __m256i* q = reinterpret_cast<const __m256i*>(p);
  return {_mm256_load_si256(q), _mm256_load_si256(q + 1)};
}
inline void store(float* p, F16 x) {
  _mm256_store_ps(p, x.a);
  _mm256_store_ps(p + 8, x.b);
}
inline void store(int32_t* p, I16 x) {
  _mm256_store_si256(reinterpret_cast<__m256i*>(p), x.a);
  _mm256_store_si256(reinterpret_cast<__m256i*>(p) + 1, x.b);
}
inline F16 all(float s) { return {_mm256_set1_ps(s), _mm256_set1_ps(s)}; }
inline I16 all(int32_t s) { return {_mm256_set1_epi32(s), _mm256_set1_epi32(s)}; }
inline F16 operator+(F16 x, F16 y) { return {_mm256_add_ps(x.a, y.a), _mm256_add_ps(x.b, y.b)}; }
inline F16 operator-(F16 x, F16 y) { return {_mm256_sub_ps(x.a, y.a), _mm256_sub_ps(x.b, y.b)}; }
inline F16 operator*(F16 x, F16 y) { return {_mm256_mul_ps(x.a, y.a), _mm256_mul_ps(x.b, y.b)}; }
inline F16 min(F16 x, F16 y) { return {_mm256_min_ps(x.a, y.a), _mm256_min_ps(x.b, y.b)}; }
inline F16 max(F16 x, F16 y) { return {_mm256_max_ps(x.a, y.a), _mm256_max_ps(x.b, y.b)}; }
inline M16 operator<(F16 x, F16 y) {
  return {_mm256_cmp_ps(x.a, y.a, _CMP_LT_OQ), _mm256_cmp_ps(x.b, y.b, _CMP_LT_OQ)};
}
inline M16 operator<=(F16 x, F16 y) {
  return {_mm256_cmp_ps(x.a, y.a, _CMP_LE_OQ), _mm256_cmp_ps(x.b, y.b, _CMP_LE_OQ)};
}
inline M16 operator==(F16 x, F16 y) {
  return {_mm256_cmp_ps(x.a, y.a, _CMP_EQ_OQ), _mm256_cmp_ps(x.b, y.b, _CMP_EQ_OQ)};
}
inline M16 operator<(I16 x, I16 y) {
  return {_mm256_castsi256_ps(_mm256_cmpgt_epi32(y.a, x.a)),
          _mm256_castsi256_ps(_mm256_cmpgt_epi32(y.b, x.b))};
}
inline M16 both(M16 x, M16 y) { return {_mm256_and_ps(x.a, y.a), _mm256_and_ps(x.b, y.b)}; }
inline M16 either(M16 x, M16 y) { return {_mm256_or_ps(x.a, y.a), _mm256_or_ps(x.b, y.b)}; }
inline Mask bits(M16 m) {
  return static_cast<Mask>(_mm256_movemask_ps(m.a)) | static_cast<Mask>(_mm256_movemask_ps(m.b))
                                                          << 8;
}
inline F16 select(M16 m, F16 yes, F16 no) {
  return {_mm256_blendv_ps(no.a, yes.a, m.a), _mm256_blendv_ps(no.b, yes.b, m.b)};
}
inline I16 select(M16 m, I16 yes, I16 no) {
  return {_mm256_blendv_epi8(no.a, yes.a, _mm256_castps_si256(m.a)),
          _mm256_blendv_epi8(no.b, yes.b, _mm256_castps_si256(m.b))};
}

// One more in the chosen lanes.
inline I16 count(I16 n, M16 m) {
  return {_mm256_sub_epi32(n.a, _mm256_castps_si256(m.a)),
          _mm256_sub_epi32(n.b, _mm256_castps_si256(m.b))};
}

inline float largest(F16 x) {
  const __m256 m = _mm256_max_ps(x.a, x.b);
  __m128 q = _mm_max_ps(_mm256_castps256_ps128(m), _mm256_extractf128_ps(m, 1));
  q = _mm_max_ps(q, _mm_movehl_ps(q, q));
  return _mm_cvtss_f32(_mm_max_ss(q, _mm_movehdup_ps(q)));
}

// For each set of eight lanes, their numbers in a row, a byte each.
struct CompressTable {
  uint64_t lanes[256];
};
constexpr CompressTable make_compress_table() {
  CompressTable table = {};
  for (int set = 0; set < 256; ++set) {
    int count = 0;
    for (uint64_t lane = 0; lane < 8; ++lane) {
      if ((set >> lane & 1) != 0) table.lanes[set] |= lane << (8 * count++);
    }
  }
  return table;
}
constexpr CompressTable kCompress = make_compress_table();

inline void compress8(int32_t* p, __m256i a, Mask chosen) {
  const __m128i lanes = _mm_cvtsi64_si128(static_cast<int64_t>(kCompress.lanes[chosen]));
  _mm256_storeu_si256(reinterpret_cast<__m256i*>(p),
                      _mm256_permutevar8x32_epi32(a, _mm256_cvtepu8_epi32(lanes)));
}

// Writes the chosen lanes in a row from p on; the rest of the sixteen places after p is garbage.
inline void compress(int32_t* p, I16 x, Mask chosen) {
  compress8(p, x.a, chosen & 255U);
  compress8(p + __builtin_popcount(chosen & 255U), x.b, chosen >> 8);
}
inline void compress(float* p, F16 x, Mask chosen) {
  compress(reinterpret_cast<int32_t*>(p), I16{_mm256_castps_si256(x.a), _mm256_castps_si256(x.b)},
           chosen);
}

}  // namespace ptn::PTN_ISA
