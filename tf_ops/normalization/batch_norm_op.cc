#include "normalization/batch_norm_op.h"

#include <cmath>

namespace ptn {

absl::Status channel_shapes(tf::shape_inference::InferenceContext* c,
                            tf::shape_inference::ShapeHandle x, int first, int count) {
  const auto channels = c->Vector(c->RankKnown(x) ? c->Dim(x, -1) : c->UnknownDim());
  for (int i = 0; i < count; ++i) c->set_output(first + i, channels);
  return absl::OkStatus();
}

BatchNormOp::BatchNormOp(tf::OpKernelConstruction* context, bool pooled, bool gradient)
    : OpKernel(context), pooled_(pooled), gradient_(gradient) {
  OP_REQUIRES_OK(context, context->GetAttr("epsilon", &epsilon_));
  OP_REQUIRES(context, epsilon_ > 0 && std::isfinite(epsilon_),
              invalid("epsilon must be positive and finite, received ", epsilon_));
}

absl::Status BatchNormOp::check(tf::OpKernelContext* context, const tf::TensorShape& result) const {
  const int first = gradient_ ? 2 : 1, last = gradient_ ? 5 : 2;
  const tf::TensorShape& x = context->input(first - 1).shape();
  const int64_t channels = x.dim_size(x.dims() - 1);
  for (int i = first; i <= last; ++i) {
    const tf::TensorShape& shape = context->input(i).shape();
    if (shape.dims() != 1 || shape.dim_size(0) != channels) {
      return invalid("input ", i, " must have shape (C) = (", channels, "), received ",
                     shape.DebugString());
    }
  }
  if (!gradient_) return absl::OkStatus();
  for (const int i : {0, pooled_ ? 6 : 0}) {
    if (context->input(i).shape() != result) {
      return invalid(i == 0 ? "grad" : "place", " must have shape ", result.DebugString(),
                     ", received ", context->input(i).shape().DebugString());
    }
  }
  return pooled_ ? check_indices(context->input(6), "place", x.dim_size(1)) : absl::OkStatus();
}

void BatchNormOp::Compute(tf::OpKernelContext* context) {
  const tf::TensorShape& x = context->input(gradient_ ? 1 : 0).shape();
  OP_REQUIRES(context, x.dims() == (pooled_ ? 3 : 2) && (!pooled_ || x.dim_size(1) >= 1),
              invalid("x must have shape ", pooled_ ? "(G, K, C) with K >= 1" : "(R, C)",
                      ", received ", x.DebugString()));
  const int64_t channels = x.dim_size(x.dims() - 1), groups = x.dim_size(0);
  const int64_t size = pooled_ ? x.dim_size(1) : 1;
  const tf::TensorShape result({groups, channels});
  OP_REQUIRES_OK(context, check(context, result));
  tf::Tensor *main, *first, *second, *place;
  OP_REQUIRES_OK(context, context->allocate_output(0, gradient_ ? x : result, &main));
  OP_REQUIRES_OK(context, context->allocate_output(1, {channels}, &first));
  OP_REQUIRES_OK(context, context->allocate_output(2, {channels}, &second));
  first->flat<float>().setZero();
  second->flat<float>().setZero();
  if (pooled_ && !gradient_) {
    OP_REQUIRES_OK(context, context->allocate_output(3, result, &place));
  }
  if (x.num_elements() == 0) return;
  run({context, groups * size, channels, groups, size, threads_of(context)});
}

}  // namespace ptn
