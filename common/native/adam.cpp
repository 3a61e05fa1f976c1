// A step of Adam (Kingma and Ba 2015) over all weights, each of which is read and written once. With
// beta1 = 0 it is RMSprop, whose `means` stay as they are.
//
// optimizers.py checks all sizes.

#include "threads.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace {

constexpr long MOST = 1 << 14;  // numbers that a thread takes at a time

struct Block {
    int tensor;
    long first, end;
};

std::vector<Block> blocks_of(const long* sizes, int tensors) {
    std::vector<Block> blocks;
    for (int t = 0; t < tensors; t++)
        for (long first = 0; first < sizes[t]; first += MOST)
            blocks.push_back({t, first, std::min(first + MOST, sizes[t])});
    return blocks;
}

double sum_of_squares(const float* numbers, long count) {
    constexpr int LANES = 32;
    float sums[LANES]{};
    long i = 0;
    for (; i + LANES <= count; i += LANES)
        for (int lane = 0; lane < LANES; lane++) sums[lane] += numbers[i + lane] * numbers[i + lane];
    double sum = 0;
    for (float each : sums) sum += each;
    for (; i < count; i++) sum += (double)numbers[i] * numbers[i];
    return sum;
}

struct Formula {
    float scale;  // of gradients
    float to_mean, to_square;
    float rate, root, epsilon;
};

// Only in functions of their own does the compiler believe that arrays do not overlap.

void adam(float* __restrict weights, const float* __restrict gradients, float* __restrict means,
          float* __restrict squares, long count, Formula f) {
    for (long i = 0; i < count; i++) {
        const float g = f.scale * gradients[i];
        means[i] += f.to_mean * (g - means[i]);
        squares[i] += f.to_square * (g * g - squares[i]);
        weights[i] -= f.rate * means[i] / (f.root * std::sqrt(squares[i]) + f.epsilon);
    }
}

void rmsprop(float* __restrict weights, const float* __restrict gradients, float*,
             float* __restrict squares, long count, Formula f) {
    for (long i = 0; i < count; i++) {
        const float g = f.scale * gradients[i];
        squares[i] += f.to_square * (g * g - squares[i]);
        weights[i] -= f.rate * g / (f.root * std::sqrt(squares[i]) + f.epsilon);
    }
}

}  // namespace

extern "C" {

// Moves `weights` by their `gradients`, scaled so that together they are at most `longest` long; 0 does
// not scale them.
//
//     mean += (1 - beta1) * (gradient - mean);  square += (1 - beta2) * (gradient^2 - square)
//     weight -= rate * mean / (root * sqrt(square) + epsilon)
void adam_step(float* const weights[], const float* const gradients[], float* const means[],
               float* const squares[], const long sizes[], int tensors, double longest, double rate,
               double beta1, double beta2, double root, double epsilon, int threads) {
    const std::vector<Block> blocks = blocks_of(sizes, tensors);
    Formula formula{1, (float)(1 - beta1), (float)(1 - beta2), (float)rate, (float)root, (float)epsilon};
    if (longest) {
        std::vector<double> sums(blocks.size());
        Deal dealt(blocks.size());
        in_threads(threads, [&](int) {
            for (long i; dealt.next(i);) {
                const Block& b = blocks[i];
                sums[i] = sum_of_squares(gradients[b.tensor] + b.first, b.end - b.first);
            }
        });
        double sum = 0;  // in an order that does not depend on who is quicker
        for (double each : sums) sum += each;
        const double length = std::sqrt(sum);
        if (!(length <= longest)) formula.scale = longest / (length + 1e-6);  // as PyTorch does
    }
    Deal dealt(blocks.size());
    in_threads(threads, [&](int) {
        for (long i; dealt.next(i);) {
            const auto [t, first, end] = blocks[i];
            (beta1 ? adam : rmsprop)(weights[t] + first, gradients[t] + first, means[t] + first,
                                     squares[t] + first, end - first, formula);
        }
    });
}

}  // extern "C"
