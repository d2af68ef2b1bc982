#include <cmath>

#include "core/op_util.h"

namespace ptn {
namespace {

using tf::shape_inference::InferenceContext;
using tf::shape_inference::ShapeHandle;

REGISTER_OP("PointTrackNet>SelectTopK")
    .Attr("k: int >= 1")
    .Input("dist: float32")
    .Output("index: int32")
    .Output("smallest: float32")
    .SetShapeFn([](InferenceContext* c) {
      ShapeHandle dist, out;
      TF_RETURN_IF_ERROR(c->WithRankAtLeast(c->input(0), 1, &dist));
      int64_t k;
      TF_RETURN_IF_ERROR(c->GetAttr("k", &k));
      TF_RETURN_IF_ERROR(c->ReplaceDim(dist, -1, c->MakeDim(k), &out));
      c->set_output(0, out);
      c->set_output(1, out);
      return absl::OkStatus();
    })
    .Doc(R"doc(
The k smallest values of each row, smallest first, ties to the lower index.

dist: (..., N), free of NaN; infinities are allowed.
index: (..., k). With k > N the rest repeats the smallest.
smallest: (..., k), the values at `index`.
)doc");

class SelectTopKOp : public tf::OpKernel {
 public:
  explicit SelectTopKOp(tf::OpKernelConstruction* context) : OpKernel(context) {
    read_count(context, "k", &k_);
  }

  void Compute(tf::OpKernelContext* context) override {
    const tf::Tensor& dist = context->input(0);
    OP_REQUIRES(context, dist.dims() >= 1,
                invalid("dist must have shape (..., N), received a scalar"));
    tf::TensorShape shape = dist.shape();
    const int64_t columns = shape.dim_size(shape.dims() - 1);
    shape.set_dim(shape.dims() - 1, k_);
    const int64_t rows = shape.num_elements() / k_;
    tf::Tensor *index, *smallest;
    OP_REQUIRES_OK(context, context->allocate_output(0, shape, &index));
    OP_REQUIRES_OK(context, context->allocate_output(1, shape, &smallest));
    if (rows == 0) return;
    OP_REQUIRES(
        context, columns > 0,
        invalid("dist has no values to choose from, received ", dist.shape().DebugString()));
    const float* values = dist.flat<float>().data();
    for (int64_t i = 0; i < dist.NumElements(); ++i) {
      OP_REQUIRES(context, !std::isnan(values[i]),
                  invalid("dist is nan at row ", i / columns, ", column ", i % columns));
    }
    kernels().select_top_k(values, rows, columns, k_, smallest->flat<float>().data(),
                           index->flat<int32_t>().data(), threads_of(context));
  }

 private:
  int32_t k_;
};

REGISTER_KERNEL_BUILDER(Name("PointTrackNet>SelectTopK").Device(tf::DEVICE_CPU), SelectTopKOp);

}  // namespace
}  // namespace ptn
