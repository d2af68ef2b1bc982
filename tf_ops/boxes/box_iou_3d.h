// Overlap of upright boxes (x, y, z, l, w, h, yaw), independent of TensorFlow; computed in double,
// since areas are differences of large numbers.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "core/parallel.h"

namespace ptn {

constexpr int kBoxSize = 7;

struct RotatedBox {
  double x, y, bottom, top, length, width, cosine, sine, reach, volume;  // length, width: halves

  explicit RotatedBox(const float* b)
      : x(b[0]),
        y(b[1]),
        bottom(b[2] - 0.5 * b[5]),
        top(b[2] + 0.5 * b[5]),
        length(0.5 * b[3]),
        width(0.5 * b[4]),
        cosine(std::cos(static_cast<double>(b[6]))),
        sine(std::sin(static_cast<double>(b[6]))),
        reach(std::hypot(length, width)),
        volume(4 * length * width * b[5]) {}
};

inline std::vector<RotatedBox> read_boxes(const float* boxes, int64_t count) {
  std::vector<RotatedBox> result;
  result.reserve(static_cast<size_t>(count));
  for (int64_t i = 0; i < count; ++i) result.emplace_back(boxes + i * kBoxSize);
  return result;
}

// These, unlike std::min and std::max, leave loops that the compiler vectorises.
inline double lesser(double a, double b) { return a < b ? a : b; }
inline double greater(double a, double b) { return a > b ? a : b; }
inline double within(double value, double limit) { return lesser(greater(value, -limit), limit); }

// The height of the overlap, not positive without one.
inline double shared_height(const RotatedBox& p, const RotatedBox& q) {
  return lesser(p.top, q.top) - greater(p.bottom, q.bottom);
}

// False if the boxes cannot overlap: by their heights, or by the circles around their footprints.
inline bool near(const RotatedBox& p, const RotatedBox& q) {
  const double dx = p.x - q.x, dy = p.y - q.y, reach = p.reach + q.reach;
  return dx * dx + dy * dy <= reach * reach && shared_height(p, q) > 0;
}

struct Corner {
  double x, y;
};

// Twice the integral of y over x along the straight edge from a to b, for the part where
// |x| <= length and with y limited to |y| <= width. `slope` is that of the edge.
inline double twice_below(Corner a, Corner b, double slope, double inverse_slope, double length,
                          double width) {
  const double first = within(a.x, length), last = within(b.x, length);
  const double from = a.y + slope * (first - a.x), to = b.y + slope * (last - b.x);
  const double low = within(from, width), high = within(to, width);
  // The trapezium below the limited ends, and what the edge beyond the limit adds or takes.
  const double beyond = ((to - high) - (low - from)) * inverse_slope;
  return (last - first) * (low + high) + beyond * (high - low);
}

// a / b; where b is 0 to rounding, any number that is not too large will do.
inline double slope_of(double a, double b) { return a / (std::abs(b) < 1e-15 ? 1e-15 : b); }

// Area of the overlap of two footprints: in the frame of q, where q is |x| <= length, |y| <= width,
// the integral of p's upper edges less that of its lower edges, all limited to q. There are no
// branches and no corners to be kept, so it is exact to rounding for edges in common, too.
inline double shared_area(const RotatedBox& p, const RotatedBox& q) {
  const double dx = p.x - q.x, dy = p.y - q.y;
  const double cx = q.cosine * dx + q.sine * dy, cy = q.cosine * dy - q.sine * dx;
  const double cosine = p.cosine * q.cosine + p.sine * q.sine;
  const double sine = p.sine * q.cosine - p.cosine * q.sine;
  const double lx = p.length * cosine, ly = p.length * sine;
  const double wx = -p.width * sine, wy = p.width * cosine;
  // Counter-clockwise from the front left.
  const Corner a{cx + lx + wx, cy + ly + wy}, b{cx - lx + wx, cy - ly + wy};
  const Corner c{cx - lx - wx, cy - ly - wy}, d{cx + lx - wx, cy + ly - wy};
  const double along = slope_of(sine, cosine), across = -slope_of(cosine, sine);
  const double twice = twice_below(a, b, along, -across, q.length, q.width) +
                       twice_below(b, c, across, -along, q.length, q.width) +
                       twice_below(c, d, along, -across, q.length, q.width) +
                       twice_below(d, a, across, -along, q.length, q.width);
  return greater(-0.5 * twice, 0);
}

// 0 where both boxes are empty. The boxes are near.
inline double iou_3d(const RotatedBox& p, const RotatedBox& q) {
  const double smaller = lesser(p.volume, q.volume);
  const double shared = lesser(shared_area(p, q) * shared_height(p, q), smaller);
  return shared / greater(p.volume + q.volume - shared, 1e-300);
}

// The IoU of one box with others: first those that are near are chosen, then all of them are
// computed in a loop without branches.
class Row {
 public:
  // Calls store(i, iou) for each of others that may overlap the box.
  template <class Store>
  void find(const RotatedBox& box, const RotatedBox* others, int64_t count, Store&& store) {
    chosen_.clear();
    for (int64_t i = 0; i < count; ++i) {
      if (near(box, others[i])) chosen_.push_back(i);
    }
    iou_.resize(chosen_.size());
    const RotatedBox mine = box;
    const int64_t* chosen = chosen_.data();
    float* iou = iou_.data();
    const auto size = static_cast<int64_t>(chosen_.size());
    for (int64_t k = 0; k < size; ++k) {
      iou[k] = static_cast<float>(iou_3d(mine, others[chosen[k]]));
    }
    for (int64_t k = 0; k < size; ++k) store(chosen[k], iou[k]);
  }

 private:
  std::vector<int64_t> chosen_;
  std::vector<float> iou_;
};

// iou (batch, rows, columns), 0 on entry, of boxes (batch, rows) with others (batch, columns).
inline void all_ious(const RotatedBox* boxes, const RotatedBox* others, int64_t batch, int64_t rows,
                     int64_t columns, float* iou, const Parallel& parallel) {
  parallel.run(batch * rows, 8 * columns, [=](int64_t begin, int64_t end) {
    Row near;
    for (int64_t row = begin; row < end; ++row) {
      const auto store = [=](int64_t i, float value) { iou[row * columns + i] = value; };
      near.find(boxes[row], others + row / rows * columns, columns, store);
    }
  });
}

// iou (batch, count, count), 0 on entry, of boxes (batch, count) with themselves; each pair is
// computed once.
inline void mutual_ious(const RotatedBox* boxes, int64_t batch, int64_t count, float* iou,
                        const Parallel& parallel) {
  const auto row_of = [=](int64_t b, int64_t row, Row* near) {
    const RotatedBox* box = boxes + b * count + row;
    float* corner = iou + (b * count + row) * count + row;  // of the rest of the matrix
    near->find(*box, box, count - row,
               [=](int64_t i, float value) { corner[i] = corner[i * count] = value; });
  };
  // A row from the top together with one from the bottom: all parts take as long.
  const int64_t half = (count + 1) / 2;
  parallel.run(batch * half, 8 * count, [=](int64_t begin, int64_t end) {
    Row near;
    for (int64_t part = begin; part < end; ++part) {
      const int64_t b = part / half, top = part % half, bottom = count - 1 - top;
      row_of(b, top, &near);
      if (bottom != top) row_of(b, bottom, &near);
    }
  });
}

}  // namespace ptn
