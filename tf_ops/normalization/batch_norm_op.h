// Input checks and outputs of the kernels of batch normalisation.
#pragma once

#include <vector>

#include "core/op_util.h"
#include "normalization/normalizer.h"

namespace ptn {

// Outputs of shape (C), C being the last dimension of x, from output `first` on.
absl::Status channel_shapes(tf::shape_inference::InferenceContext* c,
                            tf::shape_inference::ShapeHandle x, int first, int count);

// Inputs: x, gamma, beta; of a gradient grad, x, gamma, beta, mean, variance, and place if pooled.
// Outputs: y or the gradient of x, then two of shape (C), and place (G, C) if pooled and not a
// gradient. x is (R, C), or (G, K, C) if pooled.
class BatchNormOp : public tf::OpKernel {
 public:
  BatchNormOp(tf::OpKernelConstruction* context, bool pooled, bool gradient);

  // Checks the inputs, allocates the outputs and calls `run` unless x is empty.
  void Compute(tf::OpKernelContext* context) final;

 protected:
  struct Call {
    tf::OpKernelContext* context;
    int64_t rows, channels;  // of x, flat
    int64_t groups, size;    // rows = groups * size; size is 1 unless pooled
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
