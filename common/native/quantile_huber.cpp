// The quantile Huber loss (Dabney et al. 2018, equation 10, kappa = 1) and its gradient, without the
// memory that all pairs of quantiles would take.
//
// quantile_huber.py checks all sizes.

#include "threads.h"

#include <algorithm>
#include <cmath>

namespace {

constexpr int LANES = 16;  // predictions that are compared with a target at once

// Adds up, for LANES predictions, losses and gradients over all targets.
inline void compare(const float* predicted, const float* midpoints, const float* targets, int count,
                    float* losses, float* gradients) {
    for (int j = 0; j < count; j++)
        for (int i = 0; i < LANES; i++) {
            const float u = targets[j] - predicted[i], size = std::fabs(u);
            const float share = u < 0 ? 1 - midpoints[i] : midpoints[i];
            const float bounded = std::min(size, 1.0f);  // NaN if u is NaN
            losses[i] += share * bounded * (size - 0.5f * bounded);
            gradients[i] -= share * std::copysign(bounded, u);
        }
}

}  // namespace

extern "C" {

// Writes for each of `states` its loss, and the gradient of that by each prediction, [states][predictions].
void quantile_huber(const float* predicted, const float* targets, long states, int predictions,
                    int count, float* losses, float* gradients, int threads) {
    Deal dealt(states);
    in_threads(threads, [&](int) {
        for (long s; dealt.next(s);) {
            losses[s] = 0;
            for (int first = 0; first < predictions; first += LANES) {
                const int some = std::min(LANES, predictions - first);
                float of[LANES]{}, midpoints[LANES]{}, loss[LANES]{}, gradient[LANES]{};
                std::copy_n(predicted + s * predictions + first, some, of);
                for (int i = 0; i < some; i++) midpoints[i] = (first + i + 0.5f) / predictions;
                compare(of, midpoints, targets + s * count, count, loss, gradient);
                for (int i = 0; i < some; i++) {
                    losses[s] += loss[i] / count;
                    gradients[s * predictions + first + i] = gradient[i] / count;
                }
            }
        }
    });
}

}  // extern "C"
