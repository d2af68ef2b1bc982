#include "boxes/box_iou_3d.h"

#include "boxes/check_boxes.h"

namespace ptn {
namespace {

using tf::shape_inference::InferenceContext;
using tf::shape_inference::ShapeHandle;

REGISTER_OP("PointTrackNet>BoxIou3d")
    .Input("boxes1: float32")
    .Input("boxes2: float32")
    .Output("iou: float32")
    .SetShapeFn([](InferenceContext* c) {
      ShapeHandle rows, batch1, batch2;
      TF_RETURN_IF_ERROR(c->WithRankAtLeast(c->input(0), 2, &rows));
      TF_RETURN_IF_ERROR(c->WithRankAtLeast(c->input(1), 2, &rows));
      TF_RETURN_IF_ERROR(c->Subshape(c->input(0), 0, -2, &batch1));
      TF_RETURN_IF_ERROR(c->Subshape(c->input(1), 0, -2, &batch2));
      TF_RETURN_IF_ERROR(c->Merge(batch1, batch2, &batch1));
      TF_RETURN_IF_ERROR(c->Concatenate(
          batch1, c->Matrix(c->Dim(c->input(0), -2), c->Dim(c->input(1), -2)), &rows));
      c->set_output(0, rows);
      return absl::OkStatus();
    })
    .Doc(R"doc(
Intersection over union of upright boxes (x, y, z, l, w, h, yaw), for every pair.

boxes1: (M, 7) or (B, M, 7), finite, sizes not negative.
boxes2: (K, 7) or (B, K, 7), likewise.
iou: (M, K) or (B, M, K); 0 where both boxes are empty. Of a tensor with itself each pair is computed
  once, and the result is symmetric.
)doc");

// Rank 2 is one scene, rank 3 a batch of scenes.
int64_t batch_of(const tf::Tensor& t) { return t.dims() == 3 ? t.dim_size(0) : 1; }
int64_t rows_of(const tf::Tensor& t) { return t.dim_size(t.dims() - 2); }

class BoxIou3dOp : public tf::OpKernel {
 public:
  using OpKernel::OpKernel;

  void Compute(tf::OpKernelContext* context) override {
    const tf::Tensor& boxes1 = context->input(0);
    const tf::Tensor& boxes2 = context->input(1);
    OP_REQUIRES_OK(context, check_boxes(boxes1, "boxes1"));
    OP_REQUIRES_OK(context, check_boxes(boxes2, "boxes2"));
    OP_REQUIRES(context, boxes1.dims() == boxes2.dims() && batch_of(boxes1) == batch_of(boxes2),
                invalid("boxes1 and boxes2 must have the same rank and batch size, received ",
                        boxes1.shape().DebugString(), " and ", boxes2.shape().DebugString()));
    const int64_t rows = rows_of(boxes1), columns = rows_of(boxes2);
    tf::TensorShape shape = boxes1.shape();
    OP_REQUIRES_OK(context, shape.SetDimWithStatus(shape.dims() - 1, columns));
    tf::Tensor* iou;
    OP_REQUIRES_OK(context, context->allocate_output(0, shape, &iou));
    if (iou->NumElements() == 0) return;
    const int64_t batch = batch_of(boxes1);
    float* values = iou->flat<float>().data();
    std::fill_n(values, iou->NumElements(), 0.0F);
    const auto first = read_boxes(boxes1.flat<float>().data(), batch * rows);
    if (boxes1.data() == boxes2.data() && rows == columns) {
      mutual_ious(first.data(), batch, rows, values, threads_of(context));
      return;
    }
    const auto second = read_boxes(boxes2.flat<float>().data(), batch * columns);
    all_ious(first.data(), second.data(), batch, rows, columns, values, threads_of(context));
  }
};

REGISTER_KERNEL_BUILDER(Name("PointTrackNet>BoxIou3d").Device(tf::DEVICE_CPU), BoxIou3dOp);

}  // namespace
}  // namespace ptn
