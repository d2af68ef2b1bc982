// Visiting the children of a k-d tree's group, nearest first.
//
// To be included inside the namespace of one instruction set, after kd_tree.h.

// Calls visit(place, bound) for the used places of a group whose bound is at most limit(), nearest
// first; `limit` is asked again before each visit, since visits may lower it.
template <class Limit, class Visit>
inline void nearest_first(F16 bounds, Mask used, Limit&& limit, Visit&& visit) {
  struct Place {
    float bound;
    int lane;
  };
  alignas(64) float bound[kWidth];
  store(bound, bounds);
  Place order[kWidth];
  int count = 0;
  for_each_lane(bits(bounds <= all(limit())) & used, [&](int lane) {
    int i = count++;
    for (; i > 0 && order[i - 1].bound > bound[lane]; --i) order[i] = order[i - 1];
    order[i] = {bound[lane], lane};
  });
  for (int i = 0; i < count && order[i].bound <= limit(); ++i) visit(order[i].lane);
}
