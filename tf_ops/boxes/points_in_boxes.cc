#include "boxes/box_util.h"
#include "boxes/scenes.h"

namespace ptn {
namespace {

using tf::shape_inference::InferenceContext;
using tf::shape_inference::ShapeHandle;

REGISTER_OP("PointTrackNet>PointsInBoxes")
    .Input("points: float32")
    .Input("boxes: float32")
    .Output("index: int32")
    .SetShapeFn([](InferenceContext* c) {
      ShapeHandle points;
      TF_RETURN_IF_ERROR(c->WithRankAtLeast(c->input(0), 2, &points));
      TF_RETURN_IF_ERROR(c->Subshape(points, 0, -1, &points));
      c->set_output(0, points);
      return absl::OkStatus();
    })
    .Doc(R"doc(
The box that holds each point.

points: (N, 3) or (B, N, 3), finite.
boxes: (M, 7) or (B, M, 7): x, y, z, l, w, h, yaw; finite, sizes not negative.
index: (N) or (B, N). The lowest index of the boxes that hold the point, surface included; -1: none.
)doc");

class PointsInBoxesOp : public tf::OpKernel {
 public:
  using OpKernel::OpKernel;

  void Compute(tf::OpKernelContext* context) override {
    const tf::Tensor& points = context->input(0);
    const tf::Tensor& boxes = context->input(1);
    const int rank = points.dims();
    OP_REQUIRES(context, rank >= 2 && rank <= 3 && points.dim_size(rank - 1) == 3,
                invalid("points must have shape (N, 3) or (B, N, 3), received ",
                        points.shape().DebugString()));
    OP_REQUIRES_OK(context, check_finite(points, "points"));
    OP_REQUIRES_OK(context, check_boxes(boxes, "boxes"));
    OP_REQUIRES_OK(context, check_same_batch(points, boxes, "points and boxes"));
    tf::TensorShape shape = points.shape();
    shape.RemoveLastDims(1);
    tf::Tensor* index;
    OP_REQUIRES_OK(context, context->allocate_output(0, shape, &index));
    const int64_t batch = batch_of(points), rows = rows_of(points), count = rows_of(boxes);
    const auto all_boxes = read_boxes(boxes.flat<float>().data(), batch * count);
    first_holders(points.flat<float>().data(), all_boxes.data(), batch, rows, count,
                  index->flat<int32_t>().data(), threads_of(context));
  }
};

REGISTER_KERNEL_BUILDER(Name("PointTrackNet>PointsInBoxes").Device(tf::DEVICE_CPU),
                        PointsInBoxesOp);

}  // namespace
}  // namespace ptn
