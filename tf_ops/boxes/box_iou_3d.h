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
  double x, y, z, length, width, height, cosine, sine, reach;

  explicit RotatedBox(const float* b)
      : x(b[0]),
        y(b[1]),
        z(b[2]),
        length(b[3]),
        width(b[4]),
        height(b[5]),
        cosine(std::cos(static_cast<double>(b[6]))),
        sine(std::sin(static_cast<double>(b[6]))),
        reach(0.5 * std::hypot(length, width)) {}

  double volume() const { return length * width * height; }
};

inline std::vector<RotatedBox> read_boxes(const float* boxes, int64_t count) {
  std::vector<RotatedBox> result;
  result.reserve(static_cast<size_t>(count));
  for (int64_t i = 0; i < count; ++i) result.emplace_back(boxes + i * kBoxSize);
  return result;
}

// A rectangle that is cut by four lines. Without rounding a cut adds one corner at most; with it a
// sliver's corners may alternate between the sides of a line, so there is room for the worst: every
// other one of n corners replaced by two, n + n / 2, four times from 4 on.
struct Polygon {
  static constexpr int kRoom = 19;
  double x[kRoom], y[kRoom];
  int size = 0;

  void add(double px, double py) {
    x[size] = px;
    y[size++] = py;
  }

  // The part where a x + b y <= limit (Sutherland and Hodgman, 1974).
  Polygon cut(double a, double b, double limit) const {
    Polygon result;
    for (int i = 0; i < size; ++i) {
      const int j = i + 1 < size ? i + 1 : 0;
      const double here = limit - (a * x[i] + b * y[i]), next = limit - (a * x[j] + b * y[j]);
      if (here >= 0) result.add(x[i], y[i]);
      if ((here > 0 && next < 0) || (here < 0 && next > 0)) {
        const double t = here / (here - next);
        result.add(x[i] + t * (x[j] - x[i]), y[i] + t * (y[j] - y[i]));
      }
    }
    return result;
  }

  double area() const {
    double twice = 0;
    for (int i = 1; i + 1 < size; ++i) {
      twice += (x[i] - x[0]) * (y[i + 1] - y[0]) - (x[i + 1] - x[0]) * (y[i] - y[0]);
    }
    return 0.5 * twice;
  }
};

// Area of the overlap of two footprints.
inline double shared_area(const RotatedBox& p, const RotatedBox& q) {
  const double dx = p.x - q.x, dy = p.y - q.y, reach = p.reach + q.reach;
  if (dx * dx + dy * dy > reach * reach) return 0;
  // Corners of p in the frame of q, counter-clockwise; there q is |x| <= l / 2, |y| <= w / 2.
  const double cx = q.cosine * dx + q.sine * dy, cy = q.cosine * dy - q.sine * dx;
  const double cosine = p.cosine * q.cosine + p.sine * q.sine;
  const double sine = p.sine * q.cosine - p.cosine * q.sine;
  const double lx = 0.5 * p.length * cosine, ly = 0.5 * p.length * sine;
  const double wx = -0.5 * p.width * sine, wy = 0.5 * p.width * cosine;
  Polygon polygon;
  polygon.add(cx + lx + wx, cy + ly + wy);
  polygon.add(cx - lx + wx, cy - ly + wy);
  polygon.add(cx - lx - wx, cy - ly - wy);
  polygon.add(cx + lx - wx, cy + ly - wy);
  const double half_length = 0.5 * q.length, half_width = 0.5 * q.width;
  polygon = polygon.cut(1, 0, half_length).cut(-1, 0, half_length);
  return std::max(0.0, polygon.cut(0, 1, half_width).cut(0, -1, half_width).area());
}

// Shared part over the union, 0 where the union is empty.
inline double over_union(double shared, double first, double second) {
  const double whole = first + second - shared;
  return whole > 0 ? std::min(1.0, shared / whole) : 0;
}

inline double iou_3d(const RotatedBox& p, const RotatedBox& q) {
  const double top = std::min(p.z + 0.5 * p.height, q.z + 0.5 * q.height);
  const double bottom = std::max(p.z - 0.5 * p.height, q.z - 0.5 * q.height);
  if (top <= bottom) return 0;
  return over_union(shared_area(p, q) * (top - bottom), p.volume(), q.volume());
}

// iou (batch, rows, columns) of boxes (batch, rows) with others (batch, columns).
inline void all_ious(const RotatedBox* boxes, const RotatedBox* others, int64_t batch, int64_t rows,
                     int64_t columns, float* iou, const Parallel& parallel) {
  parallel.run(batch * rows, 20 * columns, [=](int64_t begin, int64_t end) {
    for (int64_t row = begin; row < end; ++row) {
      const RotatedBox* scene = others + row / rows * columns;
      for (int64_t i = 0; i < columns; ++i) {
        iou[row * columns + i] = static_cast<float>(iou_3d(boxes[row], scene[i]));
      }
    }
  });
}

// iou (batch, count, count) of boxes (batch, count) with themselves; each pair is computed once.
inline void mutual_ious(const RotatedBox* boxes, int64_t batch, int64_t count, float* iou,
                        const Parallel& parallel) {
  const auto row_of = [=](int64_t b, int64_t row) {
    const RotatedBox* scene = boxes + b * count;
    float* matrix = iou + b * count * count;
    for (int64_t i = row; i < count; ++i) {
      const float value = static_cast<float>(iou_3d(scene[row], scene[i]));
      matrix[row * count + i] = matrix[i * count + row] = value;
    }
  };
  // A row from the top together with one from the bottom: all parts take as long.
  const int64_t half = (count + 1) / 2;
  parallel.run(batch * half, 20 * count, [=](int64_t begin, int64_t end) {
    for (int64_t part = begin; part < end; ++part) {
      const int64_t b = part / half, top = part % half, bottom = count - 1 - top;
      row_of(b, top);
      if (bottom != top) row_of(b, bottom);
    }
  });
}

}  // namespace ptn
