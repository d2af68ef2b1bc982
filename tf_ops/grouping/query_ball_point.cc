#include <cmath>

#include "core/op_util.h"

namespace ptn {
namespace {

using tf::shape_inference::InferenceContext;

REGISTER_OP("PointTrackNet>QueryBallPoint")
    .Attr("radius: float")
    .Attr("nsample: int >= 1")
    .Input("xyz1: float32")
    .Input("xyz2: float32")
    .Output("index: int32")
    .Output("count: int32")
    .SetShapeFn([](InferenceContext* c) { return neighbour_shapes(c, "nsample", true); })
    .Doc(R"doc(
The first points, in index order, around each query.

xyz1: (B, N, 3), the points, finite.
xyz2: (B, M, 3), the queries, finite.
index: (B, M, nsample). The lowest indices of xyz1 whose squared distance, in float32, is below
  radius * radius; unused places hold the first of them. Empty ball: the nearest point.
count: (B, M). Points found, at most nsample; 0 for an empty ball.
)doc");

class QueryBallPointOp : public tf::OpKernel {
 public:
  explicit QueryBallPointOp(tf::OpKernelConstruction* context) : OpKernel(context) {
    read_count(context, "nsample", &nsample_);
    OP_REQUIRES_OK(context, context->GetAttr("radius", &radius_));
    OP_REQUIRES(context, radius_ > 0 && std::isfinite(radius_),
                invalid("radius must be positive and finite, received ", radius_));
  }

  void Compute(tf::OpKernelContext* context) override {
    const tf::Tensor& xyz1 = context->input(0);
    const tf::Tensor& xyz2 = context->input(1);
    OP_REQUIRES_OK(context, check_points(xyz1, "xyz1"));
    OP_REQUIRES_OK(context, check_points(xyz2, "xyz2", xyz1.dim_size(0)));
    const int64_t batch = xyz2.dim_size(0), queries = xyz2.dim_size(1);
    tf::Tensor *index, *count;
    OP_REQUIRES_OK(context, check_not_empty(xyz1, "xyz1", batch * queries));
    OP_REQUIRES_OK(context, allocate(context, 0, {batch, queries, nsample_}, &index));
    OP_REQUIRES_OK(context, allocate(context, 1, {batch, queries}, &count));
    if (batch * queries == 0) return;
    kernels().query_ball_point(clouds_of(xyz1), clouds_of(xyz2), radius_, nsample_,
                               index->flat<int32_t>().data(), count->flat<int32_t>().data(),
                               threads_of(context));
  }

 private:
  float radius_;
  int32_t nsample_;
};

REGISTER_KERNEL_BUILDER(Name("PointTrackNet>QueryBallPoint").Device(tf::DEVICE_CPU),
                        QueryBallPointOp);

}  // namespace
}  // namespace ptn
