// See simd.h. Plain loops for the compiler to vectorise: SSE2, NEON, or whatever there is.
#pragma once

#include "core/isa.h"

namespace ptn::PTN_ISA {

template <class Number>
struct alignas(64) Lanes16 {
  Number v[16];
};
using F16 = Lanes16<float>;
using I16 = Lanes16<int32_t>;
struct M16 : Lanes16<int32_t> {};  // all bits of a lane, or none

template <class Number>
inline Lanes16<Number> load(const Number* p) {
  Lanes16<Number> r;
  for (int i = 0; i < 16; ++i) r.v[i] = p[i];
  return r;
}
template <class Number>
inline void store(Number* p, const Lanes16<Number>& a) {
  for (int i = 0; i < 16; ++i) p[i] = a.v[i];
}
template <class Number>
inline Lanes16<Number> all(Number s) {
  Lanes16<Number> r;
  for (int i = 0; i < 16; ++i) r.v[i] = s;
  return r;
}

// Defines a function of two operands lane by lane.
#define PTN_LANEWISE(result, name, operand, expression)    \
  inline result name(const operand& a, const operand& b) { \
    result r;                                              \
    for (int i = 0; i < 16; ++i) r.v[i] = (expression);    \
    return r;                                              \
  }
PTN_LANEWISE(F16, operator+, F16, a.v[i] + b.v[i])
PTN_LANEWISE(F16, operator-, F16, a.v[i] - b.v[i])
PTN_LANEWISE(F16, operator*, F16, a.v[i] * b.v[i])
PTN_LANEWISE(F16, min, F16, a.v[i] < b.v[i] ? a.v[i] : b.v[i])
PTN_LANEWISE(F16, max, F16, a.v[i] > b.v[i] ? a.v[i] : b.v[i])
PTN_LANEWISE(M16, operator<, F16, -static_cast<int32_t>(a.v[i] < b.v[i]))
PTN_LANEWISE(M16, operator<=, F16, -static_cast<int32_t>(a.v[i] <= b.v[i]))
PTN_LANEWISE(M16, operator==, F16, -static_cast<int32_t>(a.v[i] == b.v[i]))
PTN_LANEWISE(M16, operator<, I16, -static_cast<int32_t>(a.v[i] < b.v[i]))
PTN_LANEWISE(M16, both, M16, a.v[i] & b.v[i])
PTN_LANEWISE(M16, either, M16, a.v[i] | b.v[i])
#undef PTN_LANEWISE

inline Mask bits(const M16& m) {
  int32_t r = 0;
  for (int i = 0; i < 16; ++i) r |= m.v[i] & 1 << i;
  return static_cast<Mask>(r);
}

template <class Number>
inline Lanes16<Number> select(const M16& m, const Lanes16<Number>& yes, const Lanes16<Number>& no) {
  Lanes16<Number> r;
  for (int i = 0; i < 16; ++i) r.v[i] = m.v[i] != 0 ? yes.v[i] : no.v[i];
  return r;
}

// One more in the chosen lanes.
inline I16 count(const I16& n, const M16& m) {
  I16 r;
  for (int i = 0; i < 16; ++i) r.v[i] = n.v[i] - m.v[i];
  return r;
}

inline float largest(F16 a) {
  for (int step = 8; step > 0; step /= 2) {
    for (int i = 0; i < step; ++i) a.v[i] = a.v[i] > a.v[i + step] ? a.v[i] : a.v[i + step];
  }
  return a.v[0];
}

// Writes the chosen lanes in a row from p on; the rest of the sixteen places after p is garbage.
template <class Number>
inline void compress(Number* p, const Lanes16<Number>& x, Mask chosen) {
  for (int i = 0; i < 16; ++i) {
    *p = x.v[i];
    p += chosen >> i & 1U;
  }
}

}  // namespace ptn::PTN_ISA
