#include "interpolation/three_interpolate.h"

#include "core/op_util.h"

namespace ptn {
namespace {

using tf::shape_inference::DimensionHandle;
using tf::shape_inference::InferenceContext;
using tf::shape_inference::ShapeHandle;

REGISTER_OP("PointTrackNet>ThreeInterpolate")
    .Attr("T: {float32, float16, bfloat16}")
    .Input("points: T")
    .Input("index: int32")
    .Input("weight: float32")
    .Output("interpolated: T")
    .SetShapeFn([](InferenceContext* c) {
      ShapeHandle points, index;
      TF_RETURN_IF_ERROR(c->WithRank(c->input(0), 3, &points));
      TF_RETURN_IF_ERROR(c->WithRank(c->input(1), 3, &index));
      TF_RETURN_IF_ERROR(c->Merge(index, c->input(2), &index));
      DimensionHandle batch, three;
      TF_RETURN_IF_ERROR(c->Merge(c->Dim(points, 0), c->Dim(index, 0), &batch));
      TF_RETURN_IF_ERROR(c->WithValue(c->Dim(index, 2), 3, &three));
      c->set_output(0, c->MakeShape({batch, c->Dim(index, 1), c->Dim(points, 2)}));
      return absl::OkStatus();
    })
    .Doc(R"doc(
Weighted sums of three rows, in float32 whatever T.

points: (B, M, C).
index: (B, N, 3), each in [0, M).
weight: (B, N, 3).
interpolated: (B, N, C).
)doc");

REGISTER_OP("PointTrackNet>ThreeInterpolateGrad")
    .Attr("T: {float32, float16, bfloat16}")
    .Input("points: T")
    .Input("index: int32")
    .Input("weight: float32")
    .Input("grad: T")
    .Output("grad_points: T")
    .Output("grad_weight: float32")
    .SetShapeFn([](InferenceContext* c) {
      c->set_output(0, c->input(0));
      c->set_output(1, c->input(2));
      return absl::OkStatus();
    })
    .Doc(R"doc(
Gradients of ThreeInterpolate for points and weight.

points, index, weight: inputs of ThreeInterpolate.
grad: (B, N, C).
grad_points: (B, M, C).
grad_weight: (B, N, 3).
)doc");

absl::Status check_inputs(const tf::Tensor& points, const tf::Tensor& index,
                          const tf::Tensor& weight) {
  if (points.dims() != 3 || index.dims() != 3 || index.dim_size(2) != 3 ||
      index.shape() != weight.shape() || points.dim_size(0) != index.dim_size(0)) {
    return invalid("points must have shape (B, M, C), index and weight (B, N, 3), received ",
                   points.shape().DebugString(), ", ", index.shape().DebugString(), " and ",
                   weight.shape().DebugString());
  }
  return check_indices(index, "index", points.dim_size(1));
}

RowSizes sizes_of(const tf::Tensor& points, const tf::Tensor& index) {
  return {points.dim_size(0), points.dim_size(1), index.dim_size(1), points.dim_size(2)};
}

template <class T>
class ThreeInterpolateOp : public tf::OpKernel {
 public:
  using OpKernel::OpKernel;

  void Compute(tf::OpKernelContext* context) override {
    const tf::Tensor& points = context->input(0);
    const tf::Tensor& index = context->input(1);
    const tf::Tensor& weight = context->input(2);
    OP_REQUIRES_OK(context, check_inputs(points, index, weight));
    const RowSizes sizes = sizes_of(points, index);
    tf::Tensor* out;
    OP_REQUIRES_OK(context,
                   allocate(context, 0, {sizes.batch, sizes.entries, sizes.channels}, &out));
    if (out->NumElements() == 0) return;
    prefer_huge_pages(out);
    interpolate_rows(points.flat<T>().data(), index.flat<int32_t>().data(),
                     weight.flat<float>().data(), sizes, out->flat<T>().data(),
                     threads_of(context));
  }
};

template <class T>
class ThreeInterpolateGradOp : public tf::OpKernel {
 public:
  using OpKernel::OpKernel;

  void Compute(tf::OpKernelContext* context) override {
    const tf::Tensor& points = context->input(0);
    const tf::Tensor& index = context->input(1);
    const tf::Tensor& weight = context->input(2);
    const tf::Tensor& grad = context->input(3);
    OP_REQUIRES_OK(context, check_inputs(points, index, weight));
    const RowSizes sizes = sizes_of(points, index);
    OP_REQUIRES(context, has_sizes(grad, {sizes.batch, sizes.entries, sizes.channels}),
                invalid("grad must have shape [", sizes.batch, ",", sizes.entries, ",",
                        sizes.channels, "], received ", grad.shape().DebugString()));
    tf::Tensor *grad_points, *grad_weight;
    OP_REQUIRES_OK(context, context->allocate_output(0, points.shape(), &grad_points));
    OP_REQUIRES_OK(context, context->allocate_output(1, weight.shape(), &grad_weight));
    const int32_t* rows = index.flat<int32_t>().data();
    const T* upstream = grad.flat<T>().data();
    const Parallel threads = threads_of(context);
    if (points.NumElements() > 0) {
      RowSizes scattered = sizes;
      scattered.entries *= 3;
      scatter_rows(upstream, rows, weight.flat<float>().data(), 3, scattered,
                   grad_points->flat<T>().data(), threads);
    }
    if (weight.NumElements() > 0) {
      interpolation_weight_grad(points.flat<T>().data(), rows, upstream, sizes,
                                grad_weight->flat<float>().data(), threads);
    }
  }
};

PTN_REGISTER_FOR_FEATURES("ThreeInterpolate", ThreeInterpolateOp);
PTN_REGISTER_FOR_FEATURES("ThreeInterpolateGrad", ThreeInterpolateGradOp);

}  // namespace
}  // namespace ptn
