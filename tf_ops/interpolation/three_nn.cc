#include "core/op_util.h"

namespace ptn {
namespace {

using tf::shape_inference::DimensionHandle;
using tf::shape_inference::InferenceContext;
using tf::shape_inference::ShapeHandle;

constexpr int32_t kThree = 3;

REGISTER_OP("PointTrackNet>ThreeNn")
    .Input("xyz1: float32")
    .Input("xyz2: float32")
    .Output("dist2: float32")
    .Output("index: int32")
    .SetShapeFn([](InferenceContext* c) {
      ShapeHandle queries, points;
      DimensionHandle batch;
      TF_RETURN_IF_ERROR(c->WithRank(c->input(0), 3, &queries));
      TF_RETURN_IF_ERROR(c->WithRank(c->input(1), 3, &points));
      TF_RETURN_IF_ERROR(c->Merge(c->Dim(queries, 0), c->Dim(points, 0), &batch));
      const ShapeHandle out = c->MakeShape({batch, c->Dim(queries, 1), c->MakeDim(kThree)});
      c->set_output(0, out);
      c->set_output(1, out);
      return absl::OkStatus();
    })
    .Doc(R"doc(
The three nearest points of each query. The queries come first, as in PointNet++.

xyz1: (B, N, 3), the queries, finite.
xyz2: (B, M, 3), the points, finite.
dist2: (B, N, 3). SQUARED distances in float32, ascending.
index: (B, N, 3). Indices into xyz2, ties to the lower one. With M < 3 the rest repeats the nearest.
)doc");

class ThreeNnOp : public tf::OpKernel {
 public:
  using OpKernel::OpKernel;

  void Compute(tf::OpKernelContext* context) override {
    const tf::Tensor& xyz1 = context->input(0);
    const tf::Tensor& xyz2 = context->input(1);
    OP_REQUIRES_OK(context, check_points(xyz1, "xyz1"));
    OP_REQUIRES_OK(context, check_points(xyz2, "xyz2", xyz1.dim_size(0)));
    tf::Tensor *dist2, *index;
    OP_REQUIRES_OK(context, context->allocate_output(0, xyz1.shape(), &dist2));
    OP_REQUIRES_OK(context, context->allocate_output(1, xyz1.shape(), &index));
    OP_REQUIRES_OK(context, check_not_empty(xyz2, "xyz2", xyz1.NumElements()));
    if (xyz1.NumElements() == 0) return;
    kernels().knn_point(clouds_of(xyz2), clouds_of(xyz1), kThree, dist2->flat<float>().data(),
                        index->flat<int32_t>().data(), threads_of(context));
  }
};

REGISTER_KERNEL_BUILDER(Name("PointTrackNet>ThreeNn").Device(tf::DEVICE_CPU), ThreeNnOp);

}  // namespace
}  // namespace ptn
