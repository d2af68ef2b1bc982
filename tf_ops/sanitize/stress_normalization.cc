// Batch normalisation with ReLU and maximum, forward and backward, against float64.

#include <algorithm>
#include <cmath>

#include "normalization/normalizer.h"
#include "sanitize/stress.h"

namespace stress {
namespace {

constexpr float kEpsilon = 1e-3F;

struct Problem {
  int64_t groups, size, channels;
  std::vector<float> x, gamma, beta, grad, pooled_grad;

  Problem(int64_t g, int64_t k, int64_t c, uint32_t seed) : groups(g), size(k), channels(c) {
    std::mt19937 random(seed);
    x = normal(g * k * c, &random, 2.0F);
    gamma = normal(c, &random);
    beta = normal(c, &random);
    grad = normal(g * k * c, &random);
    pooled_grad = normal(g * c, &random);
  }
  int64_t rows() const { return groups * size; }
};

struct Layer {
  std::vector<float> y, mean, variance, grad_x, grad_gamma, grad_beta;
  std::vector<int32_t> place;

  Layer(const Problem& p, int64_t outputs)
      : y(outputs * p.channels),
        mean(p.channels),
        variance(p.channels),
        grad_x(p.x.size()),
        grad_gamma(p.channels),
        grad_beta(p.channels),
        place(outputs * p.channels) {}
  bool operator==(const Layer& o) const {
    return y == o.y && mean == o.mean && variance == o.variance && grad_x == o.grad_x &&
           grad_gamma == o.grad_gamma && grad_beta == o.grad_beta && place == o.place;
  }
};

Layer plain(const Kernels& set, const Problem& p, const Parallel& threads) {
  Layer l(p, p.rows());
  const int64_t rows = p.rows(), c = p.channels;
  set.column_moments(p.x.data(), rows, c, l.mean.data(), l.variance.data(), threads);
  const ptn::Normalizer n(p.gamma.data(), p.beta.data(), l.mean.data(), l.variance.data(), c,
                          kEpsilon);
  set.affine_relu(p.x.data(), n.affine(), rows, c, l.y.data(), threads);
  std::vector<double> total(static_cast<size_t>(2 * c));
  set.grad_sums(p.grad.data(), p.x.data(), n.affine(), rows, c, total.data(), threads);
  const ptn::MomentGradient m(total.data(), n, rows, c, l.grad_gamma.data(), l.grad_beta.data());
  set.affine_relu_grad(p.grad.data(), p.x.data(), n.affine(), m.affine(), rows, c, l.grad_x.data(),
                       threads);
  return l;
}

Layer pooled(const Kernels& set, const Problem& p, const Parallel& threads) {
  Layer l(p, p.groups);
  const int64_t c = p.channels;
  set.moments_and_extremes(p.x.data(), ptn::signs(p.gamma.data(), c).data(), p.groups, p.size, c,
                           l.mean.data(), l.variance.data(), l.y.data(), l.place.data(), threads);
  const ptn::Normalizer n(p.gamma.data(), p.beta.data(), l.mean.data(), l.variance.data(), c,
                          kEpsilon);
  set.affine_relu(l.y.data(), n.affine(), p.groups, c, l.y.data(), threads);
  std::vector<float> spike(l.y.size());
  std::vector<double> total(static_cast<size_t>(2 * c));
  ptn::gather_spikes(p.pooled_grad.data(), p.x.data(), l.place.data(), n, p.groups, p.size, c,
                     spike.data(), total.data());
  const ptn::MomentGradient m(total.data(), n, p.rows(), c, l.grad_gamma.data(),
                              l.grad_beta.data());
  set.pooled_grad(p.x.data(), spike.data(), l.place.data(), m.affine(), p.groups, p.size, c,
                  l.grad_x.data(), threads);
  return l;
}

bool close(float found, double expected, double scale) {
  return std::abs(static_cast<double>(found) - expected) <= 1e-4 * (1.0 + std::abs(scale));
}

// One channel of the layer in float64; `through(row)` is the gradient that passes its ReLU.
template <class Through>
void check_channel(const Problem& p, const Layer& l, int64_t c, const char* name,
                   const Through& through) {
  const auto x = [&](int64_t r) { return static_cast<double>(p.x[r * p.channels + c]); };
  const double rows = static_cast<double>(p.rows());
  double mean = 0, variance = 0, beta = 0, gamma = 0;
  for (int64_t r = 0; r < p.rows(); ++r) mean += x(r) / rows;
  for (int64_t r = 0; r < p.rows(); ++r) variance += (x(r) - mean) * (x(r) - mean) / rows;
  const double inverse = 1.0 / std::sqrt(variance + static_cast<double>(kEpsilon));
  for (int64_t r = 0; r < p.rows(); ++r) {
    beta += through(r);
    gamma += through(r) * (x(r) - mean) * inverse;
  }
  const double scale = static_cast<double>(p.gamma[c]) * inverse;
  expect(close(l.mean[c], mean, 1), name, "mean", p.rows());
  expect(close(l.variance[c], variance, variance), name, "variance", p.rows());
  expect(close(l.grad_beta[c], beta, rows), name, "grad_beta", p.rows());
  expect(close(l.grad_gamma[c], gamma, rows), name, "grad_gamma", p.rows());
  for (int64_t r = 0; r < p.rows(); ++r) {
    const double moments = (beta + (x(r) - mean) * inverse * gamma) / rows;
    expect(close(l.grad_x[r * p.channels + c], scale * (through(r) - moments), 10 * scale), name,
           "grad_x", p.rows());
  }
}

void check(const Problem& p, const Layer& whole, const Layer& max, const char* name) {
  for (int64_t c = 0; c < p.channels; ++c) {
    const auto value = [&](const Layer& l, int64_t i) { return l.y[i * p.channels + c]; };
    check_channel(p, whole, c, name, [&](int64_t r) {
      return value(whole, r) > 0 ? static_cast<double>(p.grad[r * p.channels + c]) : 0.0;
    });
    check_channel(p, max, c, name, [&](int64_t r) {
      const int64_t i = r / p.size * p.channels + c;
      const bool here = max.place[i] == r % p.size && max.y[i] > 0;
      return here ? static_cast<double>(p.pooled_grad[i]) : 0.0;
    });
    for (int64_t g = 0; g < p.groups; ++g) {
      float most = 0;
      for (int64_t k = 0; k < p.size; ++k) most = std::max(most, value(whole, g * p.size + k));
      expect(close(value(max, g), static_cast<double>(most), 10), name, "maximum", p.groups);
    }
  }
}

}  // namespace

void normalization(const Sets& sets, uint32_t seed) {
  const int64_t sizes[][3] = {{1, 1, 1}, {7, 5, 3}, {51, 5, 17}, {40, 32, 33}, {2, 300, 20}};
  for (const auto& [groups, size, channels] : sizes) {
    const Problem p(groups, size, channels, seed);
    const Layer whole = plain(*sets[0], p, ptn::serial());
    const Layer max = pooled(*sets[0], p, ptn::serial());
    check(p, whole, max, sets[0]->name);
    for (const Kernels* set : sets) {
      expect(plain(*set, p, real_threads(3)) == whole, set->name, "batch norm", groups);
      expect(pooled(*set, p, real_threads(3)) == max, set->name, "batch norm, maximum", groups);
    }
  }
}

}  // namespace stress
