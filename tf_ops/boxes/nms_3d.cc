#include "boxes/box_util.h"
#include "boxes/rotated.h"

namespace ptn {
namespace {

using tf::shape_inference::InferenceContext;
using tf::shape_inference::ShapeHandle;

REGISTER_OP("PointTrackNet>Nms3d")
    .Attr("iou_threshold: float")
    .Attr("max_output: int >= 1")
    .Input("boxes: float32")
    .Input("scores: float32")
    .Output("kept: int32")
    .SetShapeFn([](InferenceContext* c) {
      ShapeHandle shape;
      TF_RETURN_IF_ERROR(c->WithRank(c->input(0), 2, &shape));
      TF_RETURN_IF_ERROR(c->WithRank(c->input(1), 1, &shape));
      c->set_output(0, c->Vector(c->UnknownDim()));
      return absl::OkStatus();
    })
    .Doc(R"doc(
Greedy non-maximum suppression by rotated bird's-eye-view IoU.

iou_threshold: a box is dropped where its IoU with a kept one is above it; in [0, 1].
max_output: at most so many are kept.
boxes: (M, 7): x, y, z, l, w, h, yaw; finite, sizes not negative.
scores: (M), finite.
kept: (K), K <= max_output. Indices of the kept boxes by falling score, ties by index.
)doc");

class Nms3dOp : public tf::OpKernel {
 public:
  explicit Nms3dOp(tf::OpKernelConstruction* context) : OpKernel(context) {
    read_count(context, "max_output", &max_output_);
    OP_REQUIRES_OK(context, context->GetAttr("iou_threshold", &iou_threshold_));
    OP_REQUIRES(context, iou_threshold_ >= 0 && iou_threshold_ <= 1,
                invalid("iou_threshold must be in [0, 1], received ", iou_threshold_));
  }

  void Compute(tf::OpKernelContext* context) override {
    const tf::Tensor& boxes = context->input(0);
    const tf::Tensor& scores = context->input(1);
    OP_REQUIRES_OK(context, check_boxes(boxes, "boxes"));
    OP_REQUIRES(context,
                boxes.dims() == 2 && scores.dims() == 1 && scores.dim_size(0) == boxes.dim_size(0),
                invalid("boxes must have shape (M, 7) and scores (M), received ",
                        boxes.shape().DebugString(), " and ", scores.shape().DebugString()));
    OP_REQUIRES_OK(context, check_finite(scores, "scores"));
    const auto kept = suppress(read_boxes(boxes.flat<float>().data(), boxes.dim_size(0)),
                               scores.flat<float>().data(), iou_threshold_, max_output_);
    tf::Tensor* out;
    OP_REQUIRES_OK(context, context->allocate_output(0, {static_cast<int64_t>(kept.size())}, &out));
    std::copy(kept.begin(), kept.end(), out->flat<int32_t>().data());
  }

 private:
  float iou_threshold_;
  int32_t max_output_;
};

REGISTER_KERNEL_BUILDER(Name("PointTrackNet>Nms3d").Device(tf::DEVICE_CPU), Nms3dOp);

}  // namespace
}  // namespace ptn
