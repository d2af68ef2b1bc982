// See simd.h. Needs AVX-512 F and DQ.
#pragma once

#include "core/isa.h"

namespace ptn::PTN_ISA {

struct F16 {
  __m512 v;
};
struct I16 {
  __m512i v;
};
using M16 = __mmask16;

inline F16 load(const float* p) { return {_mm512_load_ps(p)}; }
inline I16 load(const int32_t* p) { return {_mm512_load_si512(p)}; }
inline void store(float* p, F16 a) { _mm512_store_ps(p, a.v); }
inline void store(int32_t* p, I16 a) { _mm512_store_si512(p, a.v); }
inline F16 all(float s) { return {_mm512_set1_ps(s)}; }
inline I16 all(int32_t s) { return {_mm512_set1_epi32(s)}; }
inline F16 operator+(F16 a, F16 b) { return {_mm512_add_ps(a.v, b.v)}; }
inline F16 operator-(F16 a, F16 b) { return {_mm512_sub_ps(a.v, b.v)}; }
inline F16 operator*(F16 a, F16 b) { return {_mm512_mul_ps(a.v, b.v)}; }
inline F16 min(F16 a, F16 b) { return {_mm512_min_ps(a.v, b.v)}; }
inline F16 max(F16 a, F16 b) { return {_mm512_max_ps(a.v, b.v)}; }
inline M16 operator<(F16 a, F16 b) { return _mm512_cmp_ps_mask(a.v, b.v, _CMP_LT_OQ); }
inline M16 operator<=(F16 a, F16 b) { return _mm512_cmp_ps_mask(a.v, b.v, _CMP_LE_OQ); }
inline M16 operator==(F16 a, F16 b) { return _mm512_cmp_ps_mask(a.v, b.v, _CMP_EQ_OQ); }
inline M16 operator<(I16 a, I16 b) { return _mm512_cmplt_epi32_mask(a.v, b.v); }
inline M16 both(M16 a, M16 b) { return a & b; }
inline M16 either(M16 a, M16 b) { return a | b; }
inline Mask bits(M16 m) { return m; }
inline F16 select(M16 m, F16 yes, F16 no) { return {_mm512_mask_blend_ps(m, no.v, yes.v)}; }
inline I16 select(M16 m, I16 yes, I16 no) { return {_mm512_mask_blend_epi32(m, no.v, yes.v)}; }

// One more in the chosen lanes.
inline I16 count(I16 n, M16 m) {
  return {_mm512_mask_add_epi32(n.v, m, n.v, _mm512_set1_epi32(1))};
}

inline float largest(F16 a) {
  const __m256 m = _mm256_max_ps(_mm512_maskz_extractf32x8_ps(255, a.v, 0),
                                 _mm512_maskz_extractf32x8_ps(255, a.v, 1));
  __m128 q = _mm_max_ps(_mm256_castps256_ps128(m), _mm256_extractf128_ps(m, 1));
  q = _mm_max_ps(q, _mm_movehl_ps(q, q));
  return _mm_cvtss_f32(_mm_max_ss(q, _mm_movehdup_ps(q)));
}

// Writes the chosen lanes in a row from p on; the rest of the sixteen places after p is garbage.
inline void compress(float* p, F16 a, Mask chosen) {
  _mm512_storeu_ps(p, _mm512_maskz_compress_ps(static_cast<__mmask16>(chosen), a.v));
}
inline void compress(int32_t* p, I16 a, Mask chosen) {
  _mm512_storeu_si512(p, _mm512_maskz_compress_epi32(static_cast<__mmask16>(chosen), a.v));
}

}  // namespace ptn::PTN_ISA
