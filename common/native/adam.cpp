// A step of Adam (Kingma and Ba 2015) over all weights, each of which is read and written once. With
// beta1 = 0 it is RMSprop, whose `means` stay as they are.
//
// optimizers.py checks sizes and layouts.

#include "threads.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace {

constexpr long BLOCK = 1 << 14;  // numbers that a thread takes at a time

struct Block {
    int tensor;
    long first, end;
};

std::vector<Block> blocks_of(const long* sizes, int tensors) {
    std::vector<Block> blocks;
    for (int t = 0; t < tensors; t++)
        for (long first = 0; first < sizes[t]; first += BLOCK)
            blocks.push_back({t, first, std::min(first + BLOCK, sizes[t])});
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

struct Coefficients {
    float scale;  // of gradients
    float to_mean, of_square, to_square;
    float rate, root, epsilon;
};

// Separate functions, because compilers heed __restrict only on parameters.

void adam(float* __restrict weights, const float* __restrict gradients, float* __restrict means,
          float* __restrict squares, long count, Coefficients c) {
    for (long i = 0; i < count; i++) {
        const float g = c.scale * gradients[i];
        means[i] += c.to_mean * (g - means[i]);
        squares[i] = c.of_square * squares[i] + c.to_square * g * g;
        weights[i] -= c.rate * means[i] / (c.root * std::sqrt(squares[i]) + c.epsilon);
    }
}

void rmsprop(float* __restrict weights, const float* __restrict gradients, float*,
             float* __restrict squares, long count, Coefficients c) {
    for (long i = 0; i < count; i++) {
        const float g = c.scale * gradients[i];
        squares[i] = c.of_square * squares[i] + c.to_square * g * g;
        weights[i] -= c.rate * g / (c.root * std::sqrt(squares[i]) + c.epsilon);
    }
}

}  // namespace

extern "C" {

// Moves `weights` by their `gradients`, scaled so that their common norm is at most `max_norm`; 0 does not
// scale them.
//
//     mean += (1 - beta1) * (gradient - mean);  square = beta2 * square + (1 - beta2) * gradient^2
//     weight -= rate / (1 - beta1^step) * mean / (sqrt(square / (1 - beta2^step)) + epsilon)
//
// Each tensor has its own number of steps, this one not included; all are equal.
void adam_step(float* const weights[], const float* const gradients[], float* const means[],
               float* const squares[], float* const steps[], const long sizes[], int tensors,
               double max_norm, double rate, double beta1, double beta2, double epsilon, int threads) {
    const std::vector<Block> blocks = blocks_of(sizes, tensors);
    for (int t = 0; t < tensors; t++) *steps[t] += 1;
    const double step = *steps[0];
    Coefficients coefficients{
        .scale = 1,
        .to_mean = (float)(1 - beta1),
        .of_square = (float)beta2,
        .to_square = (float)(1 - beta2),
        .rate = (float)(rate / (1 - std::pow(beta1, step))),
        .root = (float)(1 / std::sqrt(1 - std::pow(beta2, step))),
        .epsilon = (float)epsilon,
    };
    if (max_norm) {
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
        const double norm = std::sqrt(sum);
        if (norm > max_norm) coefficients.scale = max_norm / (norm + 1e-6);  // as PyTorch does
    }
    Deal dealt(blocks.size());
    in_threads(threads, [&](int) {
        for (long i; dealt.next(i);) {
            const auto [t, first, end] = blocks[i];
            (beta1 ? adam : rmsprop)(weights[t] + first, gradients[t] + first, means[t] + first,
                                     squares[t] + first, end - first, coefficients);
        }
    });
}

}  // extern "C"
