#include "normalization/batch_norm_op.h"

namespace ptn {
namespace {

using tf::shape_inference::InferenceContext;
using tf::shape_inference::ShapeHandle;

REGISTER_OP("PointTrackNet>BatchNormReluMax")
    .Attr("epsilon: float")
    .Input("x: float32")
    .Input("gamma: float32")
    .Input("beta: float32")
    .Output("y: float32")
    .Output("mean: float32")
    .Output("variance: float32")
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
place: (G, C), where in its group each y comes from; ties go to the first.
)doc");

REGISTER_OP("PointTrackNet>BatchNormReluMaxGrad")
    .Attr("epsilon: float")
    .Input("grad: float32")
    .Input("x: float32")
    .Input("gamma: float32")
    .Input("beta: float32")
    .Input("mean: float32")
    .Input("variance: float32")
    .Input("place: int32")
    .Output("grad_x: float32")
    .Output("grad_gamma: float32")
    .Output("grad_beta: float32")
    .SetShapeFn([](InferenceContext* c) {
      c->set_output(0, c->input(1));
      return channel_shapes(c, c->input(1), 1, 2);
    })
    .Doc("Gradient of BatchNormReluMax; shapes as there, grad (G, C).");

class BatchNormReluMaxOp final : public BatchNormOp {
 public:
  explicit BatchNormReluMaxOp(tf::OpKernelConstruction* context)
      : BatchNormOp(context, /*pooled=*/true, /*gradient=*/false) {}

 private:
  void run(const Call& call) const override {
    const float *gamma = call.in(1), *beta = call.in(2);
    float *y = call.out(0), *mean = call.out(1), *variance = call.out(2);
    kernels().moments_and_extremes(call.in(0), signs(gamma, call.channels).data(), call.groups,
                                   call.size, call.channels, mean, variance, y,
                                   call.out<int32_t>(3), call.threads);
    const Normalizer n(gamma, beta, mean, variance, call.channels, epsilon());
    kernels().affine_relu(y, n.affine(), call.groups, call.channels, y, call.threads);
  }
};

class BatchNormReluMaxGradOp final : public BatchNormOp {
 public:
  explicit BatchNormReluMaxGradOp(tf::OpKernelConstruction* context)
      : BatchNormOp(context, /*pooled=*/true, /*gradient=*/true) {}

 private:
  void run(const Call& call) const override {
    const float *grad = call.in(0), *x = call.in(1), *mean = call.in(4);
    const int32_t* place = call.in<int32_t>(6);
    const Normalizer n(call.in(2), call.in(3), mean, call.in(5), call.channels, epsilon());
    std::vector<float> spike(static_cast<size_t>(call.groups * call.channels));
    std::vector<double> total(static_cast<size_t>(2 * call.channels));
    gather_spikes(grad, x, place, n, mean, call.groups, call.size, call.channels, spike.data(),
                  total.data());
    const MomentGradient moments(total.data(), n, mean, call.rows, call.channels, call.out(1),
                                 call.out(2));
    kernels().pooled_grad(x, spike.data(), place, moments.affine(), call.groups, call.size,
                          call.channels, call.out(0), call.threads);
  }
};

REGISTER_KERNEL_BUILDER(Name("PointTrackNet>BatchNormReluMax").Device(tf::DEVICE_CPU),
                        BatchNormReluMaxOp);
REGISTER_KERNEL_BUILDER(Name("PointTrackNet>BatchNormReluMaxGrad").Device(tf::DEVICE_CPU),
                        BatchNormReluMaxGradOp);

}  // namespace
}  // namespace ptn
