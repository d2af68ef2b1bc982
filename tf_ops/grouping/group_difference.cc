#include "core/op_util.h"

namespace ptn {
namespace {

REGISTER_OP("PointTrackNet>GroupDifference")
    .Attr("relu: bool")
    .Input("points: float32")
    .Input("index: int32")
    .Input("query: float32")
    .Input("pair: float32")
    .Input("weight: float32")
    .Output("grouped: float32")
    .SetShapeFn(grouped_shape)
    .Doc(R"doc(
points[b, index[b, m, k]] - query[b, m] + pair[b, m, k] weight, and its positive part if `relu`.

points: (B, N, C).
index: (B, M, K), each in [0, N).
query: (B, M, C).
pair: (B, M, K, E), E small; E may be 0.
weight: (E, C).
grouped: (B, M, K, C).
)doc");

class GroupDifferenceOp : public tf::OpKernel {
 public:
  explicit GroupDifferenceOp(tf::OpKernelConstruction* context) : OpKernel(context) {
    OP_REQUIRES_OK(context, context->GetAttr("relu", &relu_));
  }

  void Compute(tf::OpKernelContext* context) override {
    const tf::Tensor& points = context->input(0);
    const tf::Tensor& index = context->input(1);
    const tf::Tensor& query = context->input(2);
    const tf::Tensor& pair = context->input(3);
    const tf::Tensor& weight = context->input(4);
    OP_REQUIRES(context, shapes_fit(points, index, query, pair, weight),
                invalid("points must have shape (B, N, C), index (B, M, K), query (B, M, C), pair "
                        "(B, M, K, E) and weight (E, C), received ",
                        points.shape().DebugString(), ", ", index.shape().DebugString(), ", ",
                        query.shape().DebugString(), ", ", pair.shape().DebugString(), " and ",
                        weight.shape().DebugString()));
    tf::Tensor* grouped;
    OP_REQUIRES_OK(context, make_grouped(context, points, index, &grouped));
    if (grouped->NumElements() == 0) return;
    prefer_huge_pages(grouped);
    const GroupDifference work = {points.dim_size(0),          points.dim_size(1),
                                  points.dim_size(2),          index.dim_size(1),
                                  index.dim_size(2),           weight.dim_size(0),
                                  points.flat<float>().data(), index.flat<int32_t>().data(),
                                  query.flat<float>().data(),  pair.flat<float>().data(),
                                  weight.flat<float>().data(), relu_};
    kernels().group_difference(work, grouped->flat<float>().data(), threads_of(context));
  }

 private:
  static bool shapes_fit(const tf::Tensor& points, const tf::Tensor& index, const tf::Tensor& query,
                         const tf::Tensor& pair, const tf::Tensor& weight) {
    if (points.dims() != 3 || index.dims() != 3 || weight.dims() != 2) return false;
    const int64_t batch = points.dim_size(0), channels = points.dim_size(2);
    return index.dim_size(0) == batch && weight.dim_size(1) == channels &&
           is_grouped(pair, index) && pair.dim_size(3) == weight.dim_size(0) &&
           has_sizes(query, {batch, index.dim_size(1), channels});
  }

  bool relu_;
};

REGISTER_KERNEL_BUILDER(Name("PointTrackNet>GroupDifference").Device(tf::DEVICE_CPU),
                        GroupDifferenceOp);

}  // namespace
}  // namespace ptn
