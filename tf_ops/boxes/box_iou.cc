#include "boxes/box_util.h"
#include "boxes/scenes.h"

namespace ptn {
namespace {

using tf::shape_inference::InferenceContext;
using tf::shape_inference::ShapeHandle;

REGISTER_OP("PointTrackNet>BoxIou")
    .Attr("bev: bool")
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
Intersection over union of upright boxes (x, y, z, l, w, h, yaw), every one with every other.

bev: areas seen from above instead of volumes.
boxes1: (M, 7) or (B, M, 7), finite, sizes not negative.
boxes2: (K, 7) or (B, K, 7), likewise.
iou: (M, K) or (B, M, K); 0 where both boxes are empty.
)doc");

class BoxIouOp : public tf::OpKernel {
 public:
  explicit BoxIouOp(tf::OpKernelConstruction* context) : OpKernel(context) {
    OP_REQUIRES_OK(context, context->GetAttr("bev", &bev_));
  }

  void Compute(tf::OpKernelContext* context) override {
    const tf::Tensor& boxes1 = context->input(0);
    const tf::Tensor& boxes2 = context->input(1);
    OP_REQUIRES_OK(context, check_boxes(boxes1, "boxes1"));
    OP_REQUIRES_OK(context, check_boxes(boxes2, "boxes2"));
    OP_REQUIRES_OK(context, check_same_batch(boxes1, boxes2, "boxes1 and boxes2"));
    const int64_t rows = rows_of(boxes1), columns = rows_of(boxes2);
    tf::TensorShape shape = boxes1.shape();
    shape.set_dim(shape.dims() - 1, columns);
    tf::Tensor* iou;
    OP_REQUIRES_OK(context, context->allocate_output(0, shape, &iou));
    if (iou->NumElements() == 0) return;
    const int64_t batch = batch_of(boxes1);
    const auto first = read_boxes(boxes1.flat<float>().data(), batch * rows);
    const auto second = read_boxes(boxes2.flat<float>().data(), batch * columns);
    all_ious(bev_ ? iou_bev : iou_3d, first.data(), second.data(), batch, rows, columns,
             iou->flat<float>().data(), threads_of(context));
  }

 private:
  bool bev_;
};

REGISTER_KERNEL_BUILDER(Name("PointTrackNet>BoxIou").Device(tf::DEVICE_CPU), BoxIouOp);

}  // namespace
}  // namespace ptn
