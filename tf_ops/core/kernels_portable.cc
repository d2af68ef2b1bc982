#include "core/kernels_isa.h"
