// What the kernels of batch normalisation share: the checks at the door and the outputs.
#pragma once

#include <vector>

#include "core/op_util.h"
#include "normalization/normalizer.h"

namespace ptn {

// Outputs of shape (C), C being the last dimension of x, from output `first` on.
absl::Status channel_shapes(tf::shape_inference::InferenceContext* c,
                            tf::shape_inference::ShapeHandle x, int first, int count);

// Inputs are x, gamma, beta; or grad, x, gamma, beta, mean, variance of a gradient, which has
// place, too, if it is pooled. Outputs are what input 0 is to become, then two of shape (C), then
// place (G, C), if pooled and no gradient. x is (R, C), or (G, K, C) if pooled.
class BatchNormOp : public tf::OpKernel {
 public:
  BatchNormOp(tf::OpKernelConstruction* context, bool pooled, bool gradient);

  // Checks the inputs, makes the outputs, and leaves the work to `run` unless x is empty.
  void Compute(tf::OpKernelContext* context) final;

 protected:
  struct Call {
    tf::OpKernelContext* context;
    int64_t rows, channels;  // of x, flat
    int64_t groups, size;    // rows = groups * size, if pooled
    Parallel threads;

    template <class T = float>
    const T* in(int number) const {
      return context->input(number).flat<T>().data();
    }
    template <class T = float>
    T* out(int number) const {
      return context->mutable_output(number)->template flat<T>().data();
    }
  };

  virtual void run(const Call& call) const = 0;

  float epsilon() const { return epsilon_; }

 private:
  absl::Status check(tf::OpKernelContext* context, const tf::TensorShape& result) const;

  const bool pooled_, gradient_;
  float epsilon_;
};

}  // namespace ptn
