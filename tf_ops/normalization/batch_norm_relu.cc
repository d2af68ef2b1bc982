#include "normalization/batch_norm_op.h"

namespace ptn {
namespace {

using tf::shape_inference::InferenceContext;
using tf::shape_inference::ShapeHandle;

#define PTN_FORWARD(name)      \
  REGISTER_OP(name)            \
      .Attr("epsilon: float")  \
      .Input("x: float32")     \
      .Input("gamma: float32") \
      .Input("beta: float32")  \
      .Output("y: float32")    \
      .Output("mean: float32") \
      .Output("variance: float32")

// rank: of x.
#define PTN_GRADIENT(name, rank)                                \
  REGISTER_OP(name)                                             \
      .Attr("epsilon: float")                                   \
      .Input("grad: float32")                                   \
      .Input("x: float32")                                      \
      .Input("gamma: float32")                                  \
      .Input("beta: float32")                                   \
      .Input("mean: float32")                                   \
      .Input("variance: float32")                               \
      .Output("grad_x: float32")                                \
      .Output("grad_gamma: float32")                            \
      .Output("grad_beta: float32")                             \
      .SetShapeFn([](InferenceContext* c) {                     \
        ShapeHandle x;                                          \
        TF_RETURN_IF_ERROR(c->WithRank(c->input(1), rank, &x)); \
        c->set_output(0, x);                                    \
        return channel_shapes(c, x, 1, 2);                      \
      })

PTN_FORWARD("PointTrackNet>BatchNormRelu")
    .SetShapeFn([](InferenceContext* c) {
      ShapeHandle x;
      TF_RETURN_IF_ERROR(c->WithRank(c->input(0), 2, &x));
      c->set_output(0, x);
      return channel_shapes(c, x, 1, 2);
    })
    .Doc(R"doc(
relu(gamma * (x - mean) / sqrt(variance + epsilon) + beta) with the moments of the rows of x.

x: (R, C).
gamma: (C).
beta: (C).
y: (R, C).
mean: (C).
variance: (C), biased. Both are 0 if R = 0.
)doc");

PTN_FORWARD("PointTrackNet>BatchNormReluMax")
    .Output("place: int32")
    .SetShapeFn([](InferenceContext* c) {
      ShapeHandle x;
      TF_RETURN_IF_ERROR(c->WithRank(c->input(0), 3, &x));
      const ShapeHandle pooled = c->Matrix(c->Dim(x, 0), c->Dim(x, 2));
      c->set_output(0, pooled);
      c->set_output(3, pooled);
      return channel_shapes(c, x, 1, 2);
    })
    .Doc(R"doc(
The maximum over K of BatchNormRelu of the rows of x. Both steps are monotonic in x, so the
largest x of each group (the smallest where gamma < 0) is found first and normalised alone.

x: (G, K, C), K >= 1.
gamma: (C).
beta: (C).
y: (G, C).
mean: (C).
variance: (C), biased. Both are 0 if G = 0.
place: (G, C), the place in its group that each y comes from; ties go to the first.
)doc");

PTN_GRADIENT("PointTrackNet>BatchNormReluGrad", 2)
    .Doc("Gradient of BatchNormRelu; shapes as there, grad (R, C).");

PTN_GRADIENT("PointTrackNet>BatchNormReluMaxGrad", 3)
    .Input("place: int32")
    .Doc("Gradient of BatchNormReluMax; shapes as there, grad (G, C).");

// `pooled`: with the maximum over neighbours.
template <bool pooled>
class BatchNormReluOp final : public BatchNormOp {
 public:
  explicit BatchNormReluOp(tf::OpKernelConstruction* context)
      : BatchNormOp(context, pooled, /*gradient=*/false) {}

 private:
  void run(const Call& call) const override {
    const float *x = call.in(0), *gamma = call.in(1), *beta = call.in(2);
    float *y = call.out(0), *mean = call.out(1), *variance = call.out(2);
    if constexpr (pooled) {
      kernels().moments_and_extremes(x, signs(gamma, call.channels).data(), call.groups, call.size,
                                     call.channels, mean, variance, y, call.out<int32_t>(3),
                                     call.threads);
    } else {
      kernels().column_moments(x, call.rows, call.channels, mean, variance, call.threads);
    }
    const Normalizer n(gamma, beta, mean, variance, call.channels, epsilon());
    kernels().affine_relu(pooled ? y : x, n.affine(), call.groups, call.channels, y, call.threads);
  }
};

template <bool pooled>
class BatchNormReluGradOp final : public BatchNormOp {
 public:
  explicit BatchNormReluGradOp(tf::OpKernelConstruction* context)
      : BatchNormOp(context, pooled, /*gradient=*/true) {}

 private:
  void run(const Call& call) const override {
    const float *grad = call.in(0), *x = call.in(1);
    const int64_t rows = call.rows, channels = call.channels;
    const Normalizer n(call.in(2), call.in(3), call.in(4), call.in(5), channels, epsilon());
    std::vector<double> total(static_cast<size_t>(2 * channels));
    std::vector<float> spike(static_cast<size_t>(pooled ? call.groups * channels : 0));
    if constexpr (pooled) {
      gather_spikes(grad, x, call.in<int32_t>(6), n, call.groups, call.size, channels, spike.data(),
                    total.data());
    } else {
      kernels().grad_sums(grad, x, n.affine(), rows, channels, total.data(), call.threads);
    }
    const MomentGradient moments(total.data(), n, rows, channels, call.out(1), call.out(2));
    if constexpr (pooled) {
      kernels().pooled_grad(x, spike.data(), call.in<int32_t>(6), moments.affine(), call.groups,
                            call.size, channels, call.out(0), call.threads);
    } else {
      kernels().affine_relu_grad(grad, x, n.affine(), moments.affine(), rows, channels, call.out(0),
                                 call.threads);
    }
  }
};

#define PTN_KERNEL(name, Op) \
  REGISTER_KERNEL_BUILDER(Name("PointTrackNet>" name).Device(tf::DEVICE_CPU), Op)
PTN_KERNEL("BatchNormRelu", BatchNormReluOp<false>);
PTN_KERNEL("BatchNormReluMax", BatchNormReluOp<true>);
PTN_KERNEL("BatchNormReluGrad", BatchNormReluGradOp<false>);
PTN_KERNEL("BatchNormReluMaxGrad", BatchNormReluGradOp<true>);
#undef PTN_KERNEL

}  // namespace
}  // namespace ptn
