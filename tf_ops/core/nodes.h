// Visiting the children of a k-d tree's group, nearest first.
#pragma once

#include "core/isa.h"
#include "core/kd_tree.h"

namespace ptn::PTN_ISA {

// Calls visit(place) for the used places of a group whose bound is at most limit(), nearest
// first; `limit` is evaluated before each visit, since visits may lower it.
template <class Limit, class Visit>
inline void nearest_first(F16 bounds, Mask used, Limit&& limit, Visit&& visit) {
  for (Mask left = used; left != 0;) {
    const float nearest = -largest(all(0.0F) - bounds);
    const Mask now = bits(bounds == all(nearest)) & left;
    if (nearest > limit() || now == 0) return;
    left &= ~now;
    bounds = select(bounds <= all(nearest), all(kInfinity), bounds);
    for_each_lane(now, [&](int lane) {
      if (nearest <= limit()) visit(lane);
    });
  }
}

}  // namespace ptn::PTN_ISA
