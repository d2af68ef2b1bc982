#include "normalization/batch_norm_op.h"

namespace ptn {
namespace {

using tf::shape_inference::InferenceContext;
using tf::shape_inference::ShapeHandle;

REGISTER_OP("PointTrackNet>BatchNormRelu")
    .Attr("epsilon: float")
    .Input("x: float32")
    .Input("gamma: float32")
    .Input("beta: float32")
    .Output("y: float32")
    .Output("mean: float32")
    .Output("variance: float32")
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

REGISTER_OP("PointTrackNet>BatchNormReluGrad")
    .Attr("epsilon: float")
    .Input("grad: float32")
    .Input("x: float32")
    .Input("gamma: float32")
    .Input("beta: float32")
    .Input("mean: float32")
    .Input("variance: float32")
    .Output("grad_x: float32")
    .Output("grad_gamma: float32")
    .Output("grad_beta: float32")
    .SetShapeFn([](InferenceContext* c) {
      c->set_output(0, c->input(1));
      return channel_shapes(c, c->input(1), 1, 2);
    })
    .Doc("Gradient of BatchNormRelu; shapes as there, grad (R, C).");

class BatchNormReluOp final : public BatchNormOp {
 public:
  explicit BatchNormReluOp(tf::OpKernelConstruction* context)
      : BatchNormOp(context, /*pooled=*/false, /*gradient=*/false) {}

 private:
  void run(const Call& call) const override {
    const float *x = call.in(0), *gamma = call.in(1), *beta = call.in(2);
    float *y = call.out(0), *mean = call.out(1), *variance = call.out(2);
    kernels().column_moments(x, call.rows, call.channels, mean, variance, call.threads);
    const Normalizer n(gamma, beta, mean, variance, call.channels, epsilon());
    kernels().affine_relu(x, n.affine(), call.rows, call.channels, y, call.threads);
  }
};

class BatchNormReluGradOp final : public BatchNormOp {
 public:
  explicit BatchNormReluGradOp(tf::OpKernelConstruction* context)
      : BatchNormOp(context, /*pooled=*/false, /*gradient=*/true) {}

 private:
  void run(const Call& call) const override {
    const float *grad = call.in(0), *x = call.in(1), *mean = call.in(4);
    const Normalizer n(call.in(2), call.in(3), mean, call.in(5), call.channels, epsilon());
    std::vector<double> total(static_cast<size_t>(2 * call.channels));
    kernels().grad_sums(grad, x, n.affine(), mean, call.rows, call.channels, total.data(),
                        call.threads);
    const MomentGradient moments(total.data(), n, mean, call.rows, call.channels, call.out(1),
                                 call.out(2));
    kernels().affine_relu_grad(grad, x, n.affine(), moments.affine(), call.rows, call.channels,
                               call.out(0), call.threads);
  }
};

REGISTER_KERNEL_BUILDER(Name("PointTrackNet>BatchNormRelu").Device(tf::DEVICE_CPU),
                        BatchNormReluOp);
REGISTER_KERNEL_BUILDER(Name("PointTrackNet>BatchNormReluGrad").Device(tf::DEVICE_CPU),
                        BatchNormReluGradOp);

}  // namespace
}  // namespace ptn
