#include "core/op_util.h"

namespace ptn {
namespace {

using tf::shape_inference::InferenceContext;
using tf::shape_inference::ShapeHandle;

REGISTER_OP("PointTrackNet>FarthestPointSample")
    .Attr("npoint: int >= 1")
    .Input("xyz: float32")
    .Output("index: int32")
    .SetShapeFn([](InferenceContext* c) {
      ShapeHandle xyz;
      TF_RETURN_IF_ERROR(c->WithRank(c->input(0), 3, &xyz));
      tf::shape_inference::DimensionHandle three;
      TF_RETURN_IF_ERROR(c->WithValue(c->Dim(xyz, 2), 3, &three));
      int64_t npoint;
      TF_RETURN_IF_ERROR(c->GetAttr("npoint", &npoint));
      c->set_output(0, c->MakeShape({c->Dim(xyz, 0), c->MakeDim(npoint)}));
      return absl::OkStatus();
    })
    .Doc(R"doc(
Exact farthest point sampling in float32.

xyz: (B, N, 3), finite.
index: (B, npoint). The first is 0; each next one is the point whose squared distance to the
  samples before it is largest, the lowest index among ties. With npoint > N the rest is 0.
)doc");

class FarthestPointSampleOp : public tf::OpKernel {
 public:
  explicit FarthestPointSampleOp(tf::OpKernelConstruction* context) : OpKernel(context) {
    read_count(context, "npoint", &npoint_);
  }

  void Compute(tf::OpKernelContext* context) override {
    const tf::Tensor& xyz = context->input(0);
    OP_REQUIRES_OK(context, check_points(xyz, "xyz"));
    tf::Tensor* index;
    OP_REQUIRES_OK(context, check_not_empty(xyz, "xyz", xyz.dim_size(0)));
    OP_REQUIRES_OK(context, allocate(context, 0, {xyz.dim_size(0), npoint_}, &index));
    kernels().farthest_point_sample(clouds_of(xyz), npoint_, index->flat<int32_t>().data(),
                                    threads_of(context));
  }

 private:
  int32_t npoint_;
};

REGISTER_KERNEL_BUILDER(Name("PointTrackNet>FarthestPointSample").Device(tf::DEVICE_CPU),
                        FarthestPointSampleOp);

}  // namespace
}  // namespace ptn
