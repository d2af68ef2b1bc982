#include "core/op_util.h"
#include "core/rows.h"

namespace ptn {
namespace {

using tf::shape_inference::DimensionHandle;
using tf::shape_inference::InferenceContext;
using tf::shape_inference::ShapeHandle;

REGISTER_OP("PointTrackNet>GroupPoint")
    .Attr("T: {float32, float16, bfloat16}")
    .Input("points: T")
    .Input("index: int32")
    .Output("grouped: T")
    .SetShapeFn(grouped_shape)
    .Doc(R"doc(
Rows of `points` by index, batch by batch.

points: (B, N, C).
index: (B, ...), each in [0, N).
grouped: (B, ..., C).
)doc");

REGISTER_OP("PointTrackNet>GroupPointGrad")
    .Attr("T: {float32, float16, bfloat16}")
    .Input("grad: T")
    .Input("index: int32")
    .Input("size: int32")
    .Output("grad_points: T")
    .SetShapeFn([](InferenceContext* c) {
      ShapeHandle grad, size;
      TF_RETURN_IF_ERROR(c->WithRankAtLeast(c->input(0), 3, &grad));
      TF_RETURN_IF_ERROR(c->WithRank(c->input(2), 0, &size));
      DimensionHandle rows;
      TF_RETURN_IF_ERROR(c->MakeDimForScalarInput(2, &rows));
      c->set_output(0, c->MakeShape({c->Dim(grad, 0), rows, c->Dim(grad, -1)}));
      return absl::OkStatus();
    })
    .Doc(R"doc(
Gradient of GroupPoint: sums of the rows of `grad` of the same point, in float32 and in the order
of `index`, so the result does not depend on the number of threads.

grad: (B, ..., C).
index: (B, ...), input of GroupPoint.
size: N, a scalar.
grad_points: (B, N, C).
)doc");

template <class T>
class GroupPointOp : public tf::OpKernel {
 public:
  using OpKernel::OpKernel;

  void Compute(tf::OpKernelContext* context) override {
    const tf::Tensor& points = context->input(0);
    const tf::Tensor& index = context->input(1);
    OP_REQUIRES(context,
                points.dims() == 3 && index.dims() >= 2 && points.dim_size(0) == index.dim_size(0),
                invalid("points must have shape (B, N, C) and index (B, ...), received ",
                        points.shape().DebugString(), " and ", index.shape().DebugString()));
    tf::Tensor* grouped;
    OP_REQUIRES_OK(context, make_grouped(context, points, index, &grouped));
    if (grouped->NumElements() == 0) return;
    prefer_huge_pages(grouped);
    const RowSizes sizes = {points.dim_size(0), points.dim_size(1),
                            index.NumElements() / points.dim_size(0), points.dim_size(2)};
    gather_rows(points.flat<T>().data(), index.flat<int32_t>().data(), sizes,
                grouped->flat<T>().data(), threads_of(context));
  }
};

template <class T>
class GroupPointGradOp : public tf::OpKernel {
 public:
  using OpKernel::OpKernel;

  void Compute(tf::OpKernelContext* context) override {
    const tf::Tensor& grad = context->input(0);
    const tf::Tensor& index = context->input(1);
    OP_REQUIRES(context, tf::TensorShapeUtils::IsScalar(context->input(2).shape()),
                invalid("size must be a scalar"));
    const int32_t rows = context->input(2).scalar<int32_t>()();
    OP_REQUIRES(context, rows >= 0 && index.dims() >= 2 && is_grouped(grad, index),
                invalid("grad must have shape (B, ..., C) and index (B, ...), received ",
                        grad.shape().DebugString(), " and ", index.shape().DebugString()));
    OP_REQUIRES_OK(context, check_indices(index, "index", rows));
    const int64_t batch = index.dim_size(0), channels = grad.dim_size(grad.dims() - 1);
    tf::Tensor* grad_points;
    OP_REQUIRES_OK(context, allocate(context, 0, {batch, rows, channels}, &grad_points));
    if (grad_points->NumElements() == 0) return;
    prefer_huge_pages(grad_points);
    const RowSizes sizes = {batch, rows, index.NumElements() / batch, channels};
    scatter_rows(grad.flat<T>().data(), index.flat<int32_t>().data(), nullptr, 1, sizes,
                 grad_points->flat<T>().data(), threads_of(context));
  }
};

PTN_REGISTER_FOR_FEATURES("GroupPoint", GroupPointOp);
PTN_REGISTER_FOR_FEATURES("GroupPointGrad", GroupPointGradOp);

}  // namespace
}  // namespace ptn
