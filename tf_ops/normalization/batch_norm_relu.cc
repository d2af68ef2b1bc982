#include <cmath>
#include <vector>

#include "core/op_util.h"

namespace ptn {
namespace {

using tf::shape_inference::InferenceContext;
using tf::shape_inference::ShapeHandle;

// Outputs of shape (C), C being the last dimension of x, from output `first` on.
absl::Status channel_shapes(InferenceContext* c, ShapeHandle x, int first, int count) {
  const ShapeHandle channels =
      c->RankKnown(x) ? c->Vector(c->Dim(x, -1)) : c->Vector(c->UnknownDim());
  for (int i = 0; i < count; ++i) c->set_output(first + i, channels);
  return absl::OkStatus();
}

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

absl::Status check_channels(tf::OpKernelContext* context, int first, int last, int64_t channels) {
  for (int i = first; i <= last; ++i) {
    const tf::TensorShape& shape = context->input(i).shape();
    if (shape.dims() != 1 || shape.dim_size(0) != channels) {
      return invalid("input ", i, " must have shape (C) = (", channels, "), received ",
                     shape.DebugString());
    }
  }
  return absl::OkStatus();
}

// y = scale * x + shift, per channel.
struct Normalizer {
  std::vector<float> scale, shift, inverse;  // inverse = 1 / sqrt(variance + epsilon)

  Normalizer(const float* gamma, const float* beta, const float* mean, const float* variance,
             int64_t channels, float epsilon) {
    for (int64_t c = 0; c < channels; ++c) {
      inverse.push_back(1.0F / std::sqrt(variance[c] + epsilon));
      scale.push_back(gamma[c] * inverse.back());
      shift.push_back(beta[c] - mean[c] * scale.back());
    }
  }
  Affine affine() const { return {scale.data(), shift.data()}; }
};

// From sums of the gradient g and of g * (x - mean): gradients of gamma and beta, and the part
// slope * x + offset of the gradient of x that comes through the moments.
struct MomentGradient {
  std::vector<float> slope, offset;

  MomentGradient(const double* total, const Normalizer& n, const float* mean, int64_t rows,
                 int64_t channels, float* grad_gamma, float* grad_beta) {
    for (int64_t c = 0; c < channels; ++c) {
      const auto i = static_cast<size_t>(c);
      const double inverse = static_cast<double>(n.inverse[i]);
      const double along = total[channels + c] * inverse;
      grad_beta[c] = static_cast<float>(total[c]);
      grad_gamma[c] = static_cast<float>(along);
      const double factor = static_cast<double>(n.scale[i]) / static_cast<double>(rows);
      const double slope_c = -factor * inverse * along;
      slope.push_back(static_cast<float>(slope_c));
      offset.push_back(
          static_cast<float>(-factor * total[c] - slope_c * static_cast<double>(mean[c])));
    }
  }
  GradAffine affine() const { return {slope.data(), offset.data()}; }
};

const float* data(tf::OpKernelContext* context, int input) {
  return context->input(input).flat<float>().data();
}

class BatchNormReluOp : public tf::OpKernel {
 public:
  explicit BatchNormReluOp(tf::OpKernelConstruction* context) : OpKernel(context) {
    OP_REQUIRES_OK(context, context->GetAttr("epsilon", &epsilon_));
  }

  void Compute(tf::OpKernelContext* context) override {
    const tf::Tensor& x = context->input(0);
    OP_REQUIRES(context, x.dims() == 2,
                invalid("x must have shape (R, C), received ", x.shape().DebugString()));
    const int64_t rows = x.dim_size(0), channels = x.dim_size(1);
    OP_REQUIRES_OK(context, check_channels(context, 1, 2, channels));
    tf::Tensor *y, *mean, *variance;
    OP_REQUIRES_OK(context, context->allocate_output(0, x.shape(), &y));
    OP_REQUIRES_OK(context, context->allocate_output(1, {channels}, &mean));
    OP_REQUIRES_OK(context, context->allocate_output(2, {channels}, &variance));
    mean->flat<float>().setZero();
    variance->flat<float>().setZero();
    if (x.NumElements() == 0) return;
    float* m = mean->flat<float>().data();
    float* v = variance->flat<float>().data();
    const Parallel threads = threads_of(context);
    kernels().column_moments(data(context, 0), rows, channels, m, v, threads);
    const Normalizer n(data(context, 1), data(context, 2), m, v, channels, epsilon_);
    kernels().affine_relu(data(context, 0), n.affine(), rows, channels, y->flat<float>().data(),
                          threads);
  }

 private:
  float epsilon_;
};

class BatchNormReluGradOp : public tf::OpKernel {
 public:
  explicit BatchNormReluGradOp(tf::OpKernelConstruction* context) : OpKernel(context) {
    OP_REQUIRES_OK(context, context->GetAttr("epsilon", &epsilon_));
  }

  void Compute(tf::OpKernelContext* context) override {
    const tf::Tensor& grad = context->input(0);
    const tf::Tensor& x = context->input(1);
    OP_REQUIRES(context, x.dims() == 2 && grad.shape() == x.shape(),
                invalid("grad and x must have one shape (R, C), received ",
                        grad.shape().DebugString(), " and ", x.shape().DebugString()));
    const int64_t rows = x.dim_size(0), channels = x.dim_size(1);
    OP_REQUIRES_OK(context, check_channels(context, 2, 5, channels));
    tf::Tensor *grad_x, *grad_gamma, *grad_beta;
    OP_REQUIRES_OK(context, context->allocate_output(0, x.shape(), &grad_x));
    OP_REQUIRES_OK(context, context->allocate_output(1, {channels}, &grad_gamma));
    OP_REQUIRES_OK(context, context->allocate_output(2, {channels}, &grad_beta));
    grad_gamma->flat<float>().setZero();
    grad_beta->flat<float>().setZero();
    if (x.NumElements() == 0) return;
    const float* mean = data(context, 4);
    const Normalizer n(data(context, 2), data(context, 3), mean, data(context, 5), channels,
                       epsilon_);
    const Parallel threads = threads_of(context);
    std::vector<double> total(static_cast<size_t>(2 * channels));
    kernels().grad_sums(data(context, 0), data(context, 1), n.affine(), mean, rows, channels,
                        total.data(), threads);
    const MomentGradient moments(total.data(), n, mean, rows, channels,
                                 grad_gamma->flat<float>().data(),
                                 grad_beta->flat<float>().data());
    kernels().affine_relu_grad(data(context, 0), data(context, 1), n.affine(), moments.affine(),
                               rows, channels, grad_x->flat<float>().data(), threads);
  }

 private:
  float epsilon_;
};

class BatchNormReluMaxOp : public tf::OpKernel {
 public:
  explicit BatchNormReluMaxOp(tf::OpKernelConstruction* context) : OpKernel(context) {
    OP_REQUIRES_OK(context, context->GetAttr("epsilon", &epsilon_));
  }

  void Compute(tf::OpKernelContext* context) override {
    const tf::Tensor& x = context->input(0);
    OP_REQUIRES(context, x.dims() == 3 && x.dim_size(1) >= 1,
                invalid("x must have shape (G, K, C) with K >= 1, received ",
                        x.shape().DebugString()));
    const int64_t groups = x.dim_size(0), size = x.dim_size(1), channels = x.dim_size(2);
    OP_REQUIRES_OK(context, check_channels(context, 1, 2, channels));
    tf::Tensor *y, *mean, *variance, *place;
    OP_REQUIRES_OK(context, context->allocate_output(0, {groups, channels}, &y));
    OP_REQUIRES_OK(context, context->allocate_output(1, {channels}, &mean));
    OP_REQUIRES_OK(context, context->allocate_output(2, {channels}, &variance));
    OP_REQUIRES_OK(context, context->allocate_output(3, {groups, channels}, &place));
    mean->flat<float>().setZero();
    variance->flat<float>().setZero();
    if (x.NumElements() == 0) return;
    float* m = mean->flat<float>().data();
    float* v = variance->flat<float>().data();
    float* best = y->flat<float>().data();
    std::vector<float> sign;
    for (int64_t c = 0; c < channels; ++c) sign.push_back(data(context, 1)[c] < 0 ? -1.0F : 1.0F);
    const Parallel threads = threads_of(context);
    kernels().moments_and_extremes(data(context, 0), sign.data(), groups, size, channels, m, v,
                                   best, place->flat<int32_t>().data(), threads);
    const Normalizer n(data(context, 1), data(context, 2), m, v, channels, epsilon_);
    kernels().affine_relu(best, n.affine(), groups, channels, best, threads);
  }

 private:
  float epsilon_;
};

class BatchNormReluMaxGradOp : public tf::OpKernel {
 public:
  explicit BatchNormReluMaxGradOp(tf::OpKernelConstruction* context) : OpKernel(context) {
    OP_REQUIRES_OK(context, context->GetAttr("epsilon", &epsilon_));
  }

  void Compute(tf::OpKernelContext* context) override {
    const tf::Tensor& grad = context->input(0);
    const tf::Tensor& x = context->input(1);
    const tf::Tensor& place = context->input(6);
    OP_REQUIRES(context, x.dims() == 3 && grad.dims() == 2 && place.shape() == grad.shape() &&
                             grad.dim_size(0) == x.dim_size(0) &&
                             grad.dim_size(1) == x.dim_size(2),
                invalid("x must have shape (G, K, C), grad and place (G, C), received ",
                        x.shape().DebugString(), ", ", grad.shape().DebugString(), " and ",
                        place.shape().DebugString()));
    const int64_t groups = x.dim_size(0), size = x.dim_size(1), channels = x.dim_size(2);
    OP_REQUIRES_OK(context, check_channels(context, 2, 5, channels));
    OP_REQUIRES_OK(context, check_indices(place, "place", size));
    tf::Tensor *grad_x, *grad_gamma, *grad_beta;
    OP_REQUIRES_OK(context, context->allocate_output(0, x.shape(), &grad_x));
    OP_REQUIRES_OK(context, context->allocate_output(1, {channels}, &grad_gamma));
    OP_REQUIRES_OK(context, context->allocate_output(2, {channels}, &grad_beta));
    grad_gamma->flat<float>().setZero();
    grad_beta->flat<float>().setZero();
    if (x.NumElements() == 0) return;
    const float* mean = data(context, 4);
    const Normalizer n(data(context, 2), data(context, 3), mean, data(context, 5), channels,
                       epsilon_);
    std::vector<float> spike(static_cast<size_t>(groups * channels));
    std::vector<double> total(static_cast<size_t>(2 * channels), 0.0);
    gather_spikes(context, n, groups, size, channels, spike.data(), total.data());
    const MomentGradient moments(total.data(), n, mean, groups * size, channels,
                                 grad_gamma->flat<float>().data(),
                                 grad_beta->flat<float>().data());
    kernels().pooled_grad(data(context, 1), spike.data(), place.flat<int32_t>().data(),
                          moments.affine(), groups, size, channels, grad_x->flat<float>().data(),
                          threads_of(context));
  }

 private:
  // The gradient through the ReLU at each group's place: times scale into spike (G, C), and its
  // sums, alone and times (x - mean), into total (2 C).
  static void gather_spikes(tf::OpKernelContext* context, const Normalizer& n, int64_t groups,
                            int64_t size, int64_t channels, float* spike, double* total) {
    const float* grad = data(context, 0);
    const float* x = data(context, 1);
    const float* mean = data(context, 4);
    const int32_t* place = context->input(6).flat<int32_t>().data();
    for (int64_t g = 0; g < groups; ++g) {
      for (int64_t c = 0; c < channels; ++c) {
        const int64_t i = g * channels + c;
        const float at = x[(g * size + place[i]) * channels + c];
        const float through = at * n.scale[static_cast<size_t>(c)] +
                                          n.shift[static_cast<size_t>(c)] > 0.0F
                                  ? grad[i]
                                  : 0.0F;
        spike[i] = n.scale[static_cast<size_t>(c)] * through;
        total[c] += static_cast<double>(through);
        total[channels + c] += static_cast<double>(through * (at - mean[c]));
      }
    }
  }

  float epsilon_;
};

REGISTER_KERNEL_BUILDER(Name("PointTrackNet>BatchNormRelu").Device(tf::DEVICE_CPU),
                        BatchNormReluOp);
REGISTER_KERNEL_BUILDER(Name("PointTrackNet>BatchNormReluGrad").Device(tf::DEVICE_CPU),
                        BatchNormReluGradOp);
REGISTER_KERNEL_BUILDER(Name("PointTrackNet>BatchNormReluMax").Device(tf::DEVICE_CPU),
                        BatchNormReluMaxOp);
REGISTER_KERNEL_BUILDER(Name("PointTrackNet>BatchNormReluMaxGrad").Device(tf::DEVICE_CPU),
                        BatchNormReluMaxGradOp);

}  // namespace
}  // namespace ptn
