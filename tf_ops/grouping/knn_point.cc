#include "core/op_util.h"

namespace ptn {
namespace {

using tf::shape_inference::InferenceContext;

REGISTER_OP("PointTrackNet>KnnPoint")
    .Attr("k: int >= 1")
    .Input("xyz1: float32")
    .Input("xyz2: float32")
    .Output("dist2: float32")
    .Output("index: int32")
    .SetShapeFn([](InferenceContext* c) { return neighbour_shapes(c, "k", false); })
    .Doc(R"doc(
The k nearest points of each query.

xyz1: (B, N, 3), the points, finite.
xyz2: (B, M, 3), the queries, finite.
dist2: (B, M, k). Squared distances in float32, ascending.
index: (B, M, k). Indices into xyz1, ties to the lower one. With k > N the rest repeats the nearest.
)doc");

class KnnPointOp : public tf::OpKernel {
 public:
  explicit KnnPointOp(tf::OpKernelConstruction* context) : OpKernel(context) {
    read_count(context, "k", &k_);
  }

  void Compute(tf::OpKernelContext* context) override {
    const tf::Tensor& xyz1 = context->input(0);
    const tf::Tensor& xyz2 = context->input(1);
    OP_REQUIRES_OK(context, check_points(xyz1, "xyz1"));
    OP_REQUIRES_OK(context, check_points(xyz2, "xyz2", xyz1.dim_size(0)));
    const int64_t batch = xyz2.dim_size(0), queries = xyz2.dim_size(1);
    tf::Tensor *dist2, *index;
    OP_REQUIRES_OK(context, check_not_empty(xyz1, "xyz1", batch * queries));
    OP_REQUIRES_OK(context, allocate(context, 0, {batch, queries, k_}, &dist2));
    OP_REQUIRES_OK(context, allocate(context, 1, {batch, queries, k_}, &index));
    if (batch * queries == 0) return;
    kernels().knn_point(clouds_of(xyz1), clouds_of(xyz2), k_, dist2->flat<float>().data(),
                        index->flat<int32_t>().data(), threads_of(context));
  }

 private:
  int32_t k_;
};

REGISTER_KERNEL_BUILDER(Name("PointTrackNet>KnnPoint").Device(tf::DEVICE_CPU), KnnPointOp);

}  // namespace
}  // namespace ptn
