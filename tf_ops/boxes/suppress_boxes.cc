#include "boxes/suppress_boxes.h"

#include <cmath>
#include <new>

#include "boxes/check_boxes.h"

namespace ptn {
namespace {

using tf::shape_inference::InferenceContext;
using tf::shape_inference::ShapeHandle;

REGISTER_OP("PointTrackNet>SuppressBoxes")
    .Attr("vote_iou: float")
    .Attr("nms_iou: float")
    .Attr("max_boxes: int >= 1")
    .Input("boxes: float32")
    .Input("weight: float32")
    .Output("kept: int32")
    .Output("owner: int32")
    .Output("iou: float32")
    .SetShapeFn([](InferenceContext* c) {
      ShapeHandle boxes, weight, ignored;
      TF_RETURN_IF_ERROR(c->WithRank(c->input(0), 2, &boxes));
      TF_RETURN_IF_ERROR(c->WithRank(c->input(1), 1, &weight));
      TF_RETURN_IF_ERROR(c->Merge(c->Vector(c->Dim(boxes, 0)), weight, &ignored));
      const auto kept = c->UnknownDim();
      c->set_output(0, c->Vector(kept));
      c->set_output(1, c->Vector(c->Dim(boxes, 0)));
      c->set_output(2, c->Matrix(kept, c->Dim(boxes, 0)));
      return absl::OkStatus();
    })
    .Doc(R"doc(
Greedy non-maximum suppression of boxes (x, y, z, l, w, h, yaw) by support: the sum, over the boxes
that overlap one by an IoU of at least vote_iou, of IoU times weight.

boxes: (P, 7), finite, sizes not negative.
weight: (P,), finite.
kept: (K,), at most max_boxes rows, most supported first, ties to the lower row.
owner: (P,). The place in kept of the box that takes each: the first that overlaps it by more than
  nms_iou. -1 if none of those kept does.
iou: (K, P), of the kept boxes with all.
)doc");

template <class T>
void copy_to(const std::vector<T>& values, tf::Tensor* output) {
  std::copy(values.begin(), values.end(), output->flat<T>().data());
}

class SuppressBoxesOp : public tf::OpKernel {
 public:
  explicit SuppressBoxesOp(tf::OpKernelConstruction* context) : OpKernel(context) {
    OP_REQUIRES_OK(context, context->GetAttr("vote_iou", &vote_iou_));
    OP_REQUIRES_OK(context, context->GetAttr("nms_iou", &nms_iou_));
    OP_REQUIRES(
        context, std::isfinite(vote_iou_) && std::isfinite(nms_iou_),
        invalid("vote_iou and nms_iou must be finite, received ", vote_iou_, " and ", nms_iou_));
    read_count(context, "max_boxes", &max_boxes_);
  }

  void Compute(tf::OpKernelContext* context) override {
    const tf::Tensor& boxes = context->input(0);
    const tf::Tensor& weight = context->input(1);
    OP_REQUIRES_OK(context, check_boxes(boxes, "boxes"));
    OP_REQUIRES_OK(context, check_finite(weight, "weight"));
    const int64_t count = boxes.dim_size(0);
    OP_REQUIRES(context, boxes.dims() == 2 && weight.shape() == tf::TensorShape({count}),
                invalid("boxes and weight must have shapes (P, 7) and (P,), received ",
                        boxes.shape().DebugString(), " and ", weight.shape().DebugString()));
    Suppressed found;
    try {
      const auto all = read_boxes(boxes.flat<float>().data(), count);
      const auto support = supports(all, weight.flat<float>().data(), vote_iou_);
      found = suppress(all, support, nms_iou_, max_boxes_);
    } catch (const std::bad_alloc&) {  // TensorFlow would end the process
      context->CtxFailure(absl::ResourceExhaustedError(
          absl::StrCat("no memory to suppress ", count, " boxes, at most ", max_boxes_, " kept")));
      return;
    }
    const auto size = static_cast<int64_t>(found.kept.size());
    tf::Tensor *kept, *owner, *iou;
    OP_REQUIRES_OK(context, context->allocate_output(0, {size}, &kept));
    OP_REQUIRES_OK(context, context->allocate_output(1, {count}, &owner));
    OP_REQUIRES_OK(context, context->allocate_output(2, {size, count}, &iou));
    copy_to(found.kept, kept);
    copy_to(found.owner, owner);
    copy_to(found.iou, iou);
  }

 private:
  float vote_iou_, nms_iou_;
  int32_t max_boxes_;
};

REGISTER_KERNEL_BUILDER(Name("PointTrackNet>SuppressBoxes").Device(tf::DEVICE_CPU),
                        SuppressBoxesOp);

}  // namespace
}  // namespace ptn
