// The convolutions and the first dense layer of Mnih et al. 2015, forward and backward, in float32 or,
// with -DBFLOAT16, in bfloat16. Sums are float32.
//
// The instruction VDPBF16PS multiplies 32 pairs of bfloat16 and adds them to 16 sums: each sum takes
// two products at once. What is summed over must thus lie in groups of two, side by side:
//
//   pass                        sums over            groups of
//   forward                     a kernel's inputs    inputs
//   gradients of activations    a layer's outputs    outputs
//   gradients of weights        states and places    states
//
// With float32 a group is one number. One operand of a product is a vector of groups, the other is a
// single group, which is repeated. A vector has 16 groups with AVX-512, which has 32 vectors in its
// registers, and 8 with AVX2, which has 16.
//
// Activations are [state][y][x][channel]. Names end in the number of their layer; 0 are the pixels.
// `a` are activations, `d` the gradients of the loss by what comes before their ReLU, `w` weights,
// `g` gradients of weights. `groups` hold those of a group of states, [y][x][channel][GROUP].
//
// network.py checks all sizes.

#include "threads.h"

#include <immintrin.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <memory>
#include <vector>

namespace {

#ifdef BFLOAT16
using number = std::uint16_t;  // its bits
constexpr int GROUP = 2;
#else
using number = float;
constexpr int GROUP = 1;
#endif
constexpr int LAST = GROUP - 1;

#ifdef __AVX512F__
using Vector = __m512;           // of float32
constexpr int WIDE = 2;          // vectors of sums side by side in most products
constexpr int MOST = 4;          // and in those of weights' gradients
constexpr int KEPT = 16;         // vectors of sums in those
#else
using Vector = __m256;
constexpr int WIDE = 1;
constexpr int MOST = 2;
constexpr int KEPT = 8;
#endif
constexpr int LANES = sizeof(Vector) / sizeof(float);
constexpr int VECTOR = LANES * GROUP;        // numbers of a vector's groups
constexpr int TILE = WIDE * LANES;           // sums side by side in most products
constexpr int LINE = 64 / sizeof(number);    // numbers of a cache line

constexpr int FRAMES = 4, SIDE = 84;
constexpr int SOME = 16;                     // pixels of a row that are placed together
constexpr int BLOCK = 4;                     // the first layer's stride: pixels come in 4x4 blocks
constexpr int S0 = SIDE / BLOCK;             // 21 blocks across
constexpr int C0 = FRAMES * BLOCK * BLOCK;   // 64 pixels of a block, [frame][y][x]
constexpr int S1 = 20, C1 = 32;              // kernel 8, stride 4: 2x2 blocks
constexpr int S2 = 9, C2 = 64;               // kernel 4, stride 2
constexpr int S3 = 7, C3 = 64;               // kernel 3, stride 1
constexpr int FEATURES = C3 * S3 * S3;       // 3136, [channel][y][x] as PyTorch has them
constexpr int HIDDEN = 512;
constexpr int A0 = S0 * S0 * C0, A1 = S1 * S1 * C1, A2 = S2 * S2 * C2, A3 = S3 * S3 * C3;
constexpr int K1 = 4 * C0, K2 = 16 * C1, K3 = 9 * C2;  // inputs of a kernel

constexpr int ROWS = 8;                      // sums below each other in those of the dense layer
constexpr int FEW = 4;                       // states that the dense layer takes one by one,
                                             // as fast as it can read its weights
constexpr int PADDED = S2 + 2;               // a row of d with zeros at both ends

// ------------------------------------------------------------------------------------- vectors

inline Vector load_vector(const float* from) {
    Vector values;
    std::memcpy(&values, from, sizeof values);
    return values;
}

// value - 0 is the value; with value + 0 the compiler would have to add, for the sake of -0.
inline Vector all(float value) { return value - Vector{}; }

inline void store_vector(float* to, Vector values) { std::memcpy(to, &values, sizeof values); }

inline Vector load_pixels(const std::uint8_t* from) {
#ifdef __AVX512F__
    return _mm512_cvtepi32_ps(_mm512_cvtepu8_epi32(_mm_loadu_si128((const __m128i*)from)));
#else
    return _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_loadl_epi64((const __m128i*)from)));
#endif
}

inline float sum_of(Vector values) {
    float sum = 0;
    for (int i = 0; i < LANES; i++) sum += values[i];
    return sum;
}

#ifdef BFLOAT16

inline __m512bh load(const number* from) { return (__m512bh)_mm512_loadu_si512(from); }

inline __m512bh repeat(const number* single) {
    std::int32_t both;
    std::memcpy(&both, single, sizeof both);
    return (__m512bh)_mm512_set1_epi32(both);
}

inline Vector add_products(Vector sums, __m512bh a, __m512bh b) { return _mm512_dpbf16_ps(sums, a, b); }

inline __m512i load_integers(const number* from) {
    return _mm512_cvtepu16_epi32(_mm256_loadu_si256((const __m256i*)from));
}

inline Vector load_floats(const number* from) {
    return _mm512_castsi512_ps(_mm512_slli_epi32(load_integers(from), 16));
}

inline void store(number* to, Vector values) {
    _mm256_storeu_si256((__m256i*)to, (__m256i)_mm512_cvtneps_pbh(values));
}

// Writes BLOCK rows of SOME values each, values(y, x) from x on, as a row of 4x4 blocks.
template <class F>
inline void store_blocks(number* to, const F& values) {
    const auto two_rows = [&](int y) {
        const auto first = (__m256i)_mm512_cvtneps_pbh(values(y, 0));
        const auto second = (__m256i)_mm512_cvtneps_pbh(values(y + 1, 0));
        return _mm512_inserti64x4(_mm512_castsi256_si512(first), second, 1);
    };
    // Four numbers are 64 bits: a block takes those at the same x of all rows.
    const __m512i above = two_rows(0), below = two_rows(2);
    for (int b = 0; b < SOME / BLOCK; b += 2) {
        const __m512i order = _mm512_setr_epi64(b, b + 4, b + 8, b + 12, b + 1, b + 5, b + 9, b + 13);
        const __m512i two_blocks = _mm512_permutex2var_epi64(above, order, below);
        _mm256_storeu_si256((__m256i*)(to + b * C0), _mm512_castsi512_si256(two_blocks));
        _mm256_storeu_si256((__m256i*)(to + (b + 1) * C0), _mm512_extracti64x4_epi64(two_blocks, 1));
    }
}

// Writes first[0], last[0], first[1], last[1], ... of `count` values each, a multiple of 16.
inline void group(const number* first, const number* last, number* to, int count) {
    for (int i = 0; i < count; i += LANES) {
        const __m512i high = _mm512_slli_epi32(load_integers(last + i), 16);
        _mm512_storeu_si512(to + 2 * i, _mm512_or_si512(load_integers(first + i), high));
    }
}

#else

inline Vector load(const number* from) { return load_vector(from); }

inline Vector repeat(const number* single) { return all(*single); }

inline Vector add_products(Vector sums, Vector a, Vector b) { return a * b + sums; }

inline Vector load_floats(const number* from) { return load_vector(from); }

inline void store(number* to, Vector values) { store_vector(to, values); }

template <class F>
inline void store_blocks(number* to, const F& values) {
    for (int y = 0; y < BLOCK; y++) {
        number row[SOME];
        for (int x = 0; x < SOME; x += LANES) store(row + x, values(y, x));
        for (int b = 0; b < SOME / BLOCK; b++)
            std::memcpy(to + b * C0 + y * BLOCK, row + b * BLOCK, BLOCK * sizeof(number));
    }
}

// The first of a group is its last, too.
inline void group(const number* first, const number*, number* to, int count) {
    std::memcpy(to, first, count * sizeof(number));
}

#endif

// Returns 0 where the activation is not positive, else d: the gradient before a ReLU.
inline Vector before_relu(Vector d, const number* activation) {
    return load_floats(activation) <= Vector{} ? Vector{} : d;
}

// R rows of V vectors of sums, which the compiler keeps in registers.
template <int R, int V = WIDE>
struct Sums {
    Vector at[R][V];

    template <class F>
    inline void each(const F& change) {
#pragma GCC unroll 32
        for (int r = 0; r < R; r++)
#pragma GCC unroll 4
            for (int v = 0; v < V; v++) change(at[r][v], r, v);
    }
    inline void start_at_zero() {
        each([](Vector& sum, int, int) { sum = Vector{}; });
    }
    // Starts at floats whose rows are `row` apart; 0 repeats a single row.
    inline void start_at(const float* from, long row) {
        each([=](Vector& sum, int r, int v) { sum = load_vector(from + r * row + v * LANES); });
    }
    // Adds the products of `groups`: the single groups of row r begin at single + r * row and are
    // `next` apart, and the V vectors of each begin `apart` after those of the one before.
    inline void add(const number* single, long row, long next, const number* vectors, long groups,
                    long apart = V * VECTOR) {
        for (long g = 0; g < groups; g++) {
            decltype(load(vectors)) vector[V];
#pragma GCC unroll 4
            for (int v = 0; v < V; v++) vector[v] = load(vectors + v * VECTOR);
#pragma GCC unroll 32
            for (int r = 0; r < R; r++) {
                const auto one = repeat(single + r * row);
#pragma GCC unroll 4
                for (int v = 0; v < V; v++) at[r][v] = add_products(at[r][v], one, vector[v]);
            }
            single += next;
            vectors += apart;
        }
    }
    inline void write(float* to, long row) {
        each([=](Vector& sum, int r, int v) { store_vector(to + r * row + v * LANES, sum); });
    }
    // Not a number stays one: it is not less than 0.
    inline void write_relu(number* to, long row) {
        each([=](Vector& sum, int r, int v) {
            store(to + r * row + v * LANES, sum < Vector{} ? Vector{} : sum);
        });
    }
    inline void write_before_relu(number* to, const number* activation, long row) {
        each([=](Vector& sum, int r, int v) {
            const long place = r * row + v * LANES;
            store(to + place, before_relu(sum, activation + place));
        });
    }
};

// --------------------------------------------------------------------------------- what is kept

// The weights in the layouts of both passes.
struct Weights {
    alignas(64) number w1[C1 / TILE][K1 / GROUP][TILE][GROUP];  // [outputs][inputs][output][input]
    alignas(64) number w2[C2 / TILE][K2 / GROUP][TILE][GROUP];
    alignas(64) number w3[C3 / TILE][K3 / GROUP][TILE][GROUP];
    // [inputs][place of the kernel][outputs][input][output]
    alignas(64) number back2[C1 / TILE][16][C2 / GROUP][TILE][GROUP];
    alignas(64) number back3[C2 / TILE][9][C3 / GROUP][TILE][GROUP];
    alignas(64) number dense[HIDDEN][FEATURES];
    alignas(64) float b1[C1], b2[C2], b3[C3], b4[HIDDEN];
    float scale;  // of the first layer's weights
};

struct Activations {  // of one state
    alignas(64) number a1[A1], a2[A2], a3[A3];
};

struct Gradients {
    alignas(64) float g1[K1][C1], g2[K2][C2], g3[K3][C3];
    alignas(64) float b1[C1], b2[C2], b3[C3];
};

// One thread's memory.
struct Scratch {
    Activations activations;
    Gradients sums;
    alignas(64) number a0_groups[GROUP * A0], a1_groups[GROUP * A1], a2_groups[GROUP * A2];
    alignas(64) number d1_groups[GROUP * A1], d2_groups[GROUP * A2], d3_groups[GROUP * A3];
    alignas(64) number d1[GROUP][A1], d2[GROUP][S2 * PADDED * C2], d3[GROUP][S3 * PADDED * C3];
    alignas(64) number dense_groups[HIDDEN / GROUP][TILE][GROUP];  // weights of a panel
};

long ceil_div(long count, long divisor) { return (count + divisor - 1) / divisor; }

template <class T>
T* at_least(std::vector<T>& memory, long count) {
    if ((long)memory.size() < count) memory.resize(count);
    return memory.data();
}

// -------------------------------------------------------------------------------------- pixels

// Returns the mean of `count` pixels, a multiple of 16; a half goes to the even number.
int mean_of(const std::uint8_t* pixels, int count) {
    __m128i sums{};  // one of each half
    for (int p = 0; p < count; p += sizeof sums) {
        const __m128i some = _mm_loadu_si128((const __m128i*)(pixels + p));
        sums = _mm_add_epi64(sums, _mm_sad_epu8(some, __m128i{}));
    }
    return (int)std::nearbyint((double)(sums[0] + sums[1]) / count);
}

// ------------------------------------------------------------------------------------- forward

// Also writes the features, a3 in PyTorch's order.
void convolve(const Weights& w, const number* a0, Activations& a, number* features) {
    constexpr int ACROSS = S1 / 2;
    for (int tile = 0; tile < C1 / TILE; tile++)
        for (int y = 0; y < S1; y++)
            for (int x = 0; x < S1; x += ACROSS) {
                for (int p = 0; p < ACROSS * C0; p += LINE)  // of the row after the next
                    __builtin_prefetch(a0 + ((y + 2) * S0 + x) * C0 + p);
                Sums<ACROSS> sums;
                sums.start_at(w.b1 + tile * TILE, 0);
                for (int k = 0; k < 2; k++)
                    sums.add(a0 + ((y + k) * S0 + x) * C0, C0, GROUP,
                             w.w1[tile][k * 2 * C0 / GROUP][0], 2 * C0 / GROUP);
                sums.write_relu(a.a1 + (y * S1 + x) * C1 + tile * TILE, C1);
            }
    for (int tile = 0; tile < C2 / TILE; tile++)
        for (int y = 0; y < S2; y++) {
            Sums<S2> sums;
            sums.start_at(w.b2 + tile * TILE, 0);
            for (int k = 0; k < 4; k++)
                sums.add(a.a1 + (2 * y + k) * S1 * C1, 2 * C1, GROUP,
                         w.w2[tile][k * 4 * C1 / GROUP][0], 4 * C1 / GROUP);
            sums.write_relu(a.a2 + y * S2 * C2 + tile * TILE, C2);
        }
    for (int tile = 0; tile < C3 / TILE; tile++)
        for (int y = 0; y < S3; y++) {
            Sums<S3> sums;
            sums.start_at(w.b3 + tile * TILE, 0);
            for (int k = 0; k < 3; k++)
                sums.add(a.a2 + (y + k) * S2 * C2, C2, GROUP, w.w3[tile][k * 3 * C2 / GROUP][0],
                         3 * C2 / GROUP);
            sums.write_relu(a.a3 + y * S3 * C3 + tile * TILE, C3);
        }
    for (int c = 0; c < C3; c++)
        for (int place = 0; place < S3 * S3; place++)
            features[c * S3 * S3 + place] = a.a3[place * C3 + c];
}

// ------------------------------------------------------------------------------------ backward

void add_places(float* sums, const number* d, int places, int channels) {
    for (int c = 0; c < channels; c += LANES) {
        Vector sum = load_vector(sums + c);
        for (int p = 0; p < places; p++) sum += load_floats(d + p * channels + c);
        store_vector(sums + c, sum);
    }
}

// Puts rows of d that are padded, `left` places before the first, side by side.
template <int S, int C>
inline void group_rows(const number* first, const number* last, int left, number* groups) {
    for (int y = 0; y < S; y++) {
        const int row = (y * PADDED + left) * C;
        group(first + row, last + row, groups + GROUP * y * S * C, S * C);
    }
}

// Adds the gradients of a convolution's weights by a group of states. It sees S_IN x S_IN places of C
// inputs, and has S x S places of OUT outputs.
template <int KERNEL, int STRIDE, int S_IN, int C, int S, int OUT>
inline void add_weights(float* g, const number* first, const number* last, number* groups,
                        const number* d_groups) {
    constexpr int V = std::min(OUT / LANES, MOST), R = KEPT / V;
    if (GROUP > 1) group(first, last, groups, S_IN * S_IN * C);
    const number* all_inputs = GROUP > 1 ? groups : first;
    for (int k = 0; k < KERNEL * KERNEL * C; k += R)
        for (int n = 0; n < OUT; n += V * LANES) {
            const int y = k / C / KERNEL, x = k / C % KERNEL, c = k % C;
            const number* inputs = all_inputs + GROUP * ((y * S_IN + x) * C + c);
            Sums<R, V> sums;
            sums.start_at(g + k * OUT + n, OUT);
            for (int row = 0; row < S; row++)
                sums.add(inputs + row * GROUP * STRIDE * S_IN * C, GROUP, GROUP * STRIDE * C,
                         d_groups + GROUP * (row * S * OUT + n), S, GROUP * OUT);
            sums.write(g + k * OUT + n, OUT);
        }
}

void third_layer(const Activations* const a[GROUP], const float* const d_features[GROUP], Scratch& s) {
    for (int i = 0; i < GROUP; i++)
        for (int y = 0; y < S3; y++) {
            number* row = s.d3[i] + (y * PADDED + 2) * C3;
            for (int x = 0; x < S3; x++) {
                float d[C3];
                for (int c = 0; c < C3; c++) d[c] = d_features[i][c * S3 * S3 + y * S3 + x];
                for (int c = 0; c < C3; c += LANES) {
                    const number* activation = a[i]->a3 + (y * S3 + x) * C3 + c;
                    store(row + x * C3 + c, before_relu(load_vector(d + c), activation));
                }
            }
            add_places(s.sums.b3, row, S3, C3);
        }
    group_rows<S3, C3>(s.d3[0], s.d3[LAST], 2, s.d3_groups);
    add_weights<3, 1, S2, C2, S3, C3>(s.sums.g3[0], a[0]->a2, a[LAST]->a2, s.a2_groups, s.d3_groups);
}

void second_layer(const Weights& w, const Activations* const a[GROUP], Scratch& s) {
    for (int i = 0; i < GROUP; i++)
        for (int y = 0; y < S2; y++) {
            number* row = s.d2[i] + (y * PADDED + 1) * C2;
            for (int tile = 0; tile < C2 / TILE; tile++) {
                Sums<S2> sums;
                sums.start_at_zero();
                for (int ky = 0; ky < 3; ky++) {
                    const int from = y - ky;
                    if (from < 0 || from >= S3) continue;
                    for (int kx = 0; kx < 3; kx++)
                        sums.add(s.d3[i] + (from * PADDED + 2 - kx) * C3, C3, GROUP,
                                 w.back3[tile][ky * 3 + kx][0][0], C3 / GROUP);
                }
                const int place = tile * TILE;
                sums.write_before_relu(row + place, a[i]->a2 + y * S2 * C2 + place, C2);
            }
            add_places(s.sums.b2, row, S2, C2);
        }
    group_rows<S2, C2>(s.d2[0], s.d2[LAST], 1, s.d2_groups);
    add_weights<4, 2, S1, C1, S2, C2>(s.sums.g2[0], a[0]->a1, a[LAST]->a1, s.a1_groups, s.d2_groups);
}

void first_layer(const Weights& w, const number* const a0[GROUP], const Activations* const a[GROUP],
                 Scratch& s) {
    for (int i = 0; i < GROUP; i++) {
        // With a stride of 2, every second place across got its outputs by the same weights.
        for (int tile = 0; tile < C1 / TILE; tile++)
            for (int y = 0; y < S1; y++)
                for (int odd = 0; odd < 2; odd++) {
                    Sums<S1 / 2> sums;
                    sums.start_at_zero();
                    for (int ky = y % 2; ky < 4; ky += 2) {
                        const int from = (y - ky) / 2;
                        if (y < ky || from >= S2) continue;
                        for (int j = 0; j < 2; j++)
                            sums.add(s.d2[i] + (from * PADDED + 1 - j) * C2, C2, GROUP,
                                     w.back2[tile][ky * 4 + odd + 2 * j][0][0], C2 / GROUP);
                    }
                    const int place = (y * S1 + odd) * C1 + tile * TILE;
                    sums.write_before_relu(s.d1[i] + place, a[i]->a1 + place, 2 * C1);
                }
        add_places(s.sums.b1, s.d1[i], S1 * S1, C1);
    }
    group(s.d1[0], s.d1[LAST], s.d1_groups, A1);
    add_weights<2, 1, S0, C0, S1, C1>(s.sums.g1[0], a0[0], a0[LAST], s.a0_groups, s.d1_groups);
}

// ------------------------------------------------------------------------------------ the trunk

// Where PyTorch has the weight of input k of the first layer, [y][x][frame] of an 8x8 kernel.
inline int of_pixel(int k) {
    const int y = k / (2 * C0) * BLOCK + k / BLOCK % BLOCK, x = k / C0 % 2 * BLOCK + k % BLOCK;
    return (y * 2 * BLOCK + x) * FRAMES + k / (BLOCK * BLOCK) % FRAMES;
}

class Trunk {
  public:
    void pack(const float* const weights[4], const float* const biases[4], long stride, float scale,
              int threads) {
        Weights& w = weights_;
        w.scale = scale;
        std::memcpy(w.b1, biases[0], sizeof w.b1);
        std::memcpy(w.b2, biases[1], sizeof w.b2);
        std::memcpy(w.b3, biases[2], sizeof w.b3);
        std::memcpy(w.b4, biases[3], sizeof w.b4);
        std::vector<number> rows(C3 * K3);
        for (int n = 0; n < C1; n++) {
            float row[K1];
            for (int k = 0; k < K1; k++) row[k] = weights[0][n * K1 + of_pixel(k)] * scale;
            to_numbers(row, rows.data() + n * K1, K1);
        }
        pack_forward<C1>(rows.data(), w.w1);
        to_numbers(weights[1], rows.data(), C2 * K2);
        pack_forward<C2>(rows.data(), w.w2);
        pack_back<C1>(rows.data(), w.back2);
        to_numbers(weights[2], rows.data(), C3 * K3);
        pack_forward<C3>(rows.data(), w.w3);
        pack_back<C2>(rows.data(), w.back3);
        Deal outputs(HIDDEN);
        in_threads(threads, [&](int) {
            for (long n; outputs.next(n);) to_numbers(weights[3] + n * stride, w.dense[n], FEATURES);
        });
    }

    void forward(const number* pixels, long states, bool keep, float* out, int threads) {
        if (keep) at_least(kept_, states);
        number* features = at_least(keep ? kept_features_ : features_, states * FEATURES);
        prepare(threads);
        Deal convolved(states);
        in_threads(threads, [&](int thread) {
            for (long i; convolved.next(i);) {
                Activations& a = keep ? kept_[i] : scratch_[thread]->activations;
                convolve(weights_, pixels + i * A0, a, features + i * FEATURES);
            }
        });
        if (states > FEW) arrange(features, states, threads);
        Deal tiles(HIDDEN / ROWS);
        in_threads(threads, [&](int) {
            for (long tile; tiles.next(tile);)
                if (states <= FEW)
                    dense_few(tile * ROWS, features, states, out);
                else
                    dense_many(tile * ROWS, states, out);
        });
    }

    // Takes the pixels of the last forward pass that was kept.
    void backward(const number* pixels, long states, const float* d, float* const weights[4],
                  float* const biases[4], long stride, int threads) {
        const long groups = ceil_div(states, GROUP), rows = ceil_div(states, ROWS) * ROWS;
        number* d_plain = at_least(d_plain_, rows * HIDDEN);
        // [output / 8][group][output][GROUP] and [feature / TILE][group][feature][GROUP]
        number* d_groups = at_least(d_groups_, groups * GROUP * HIDDEN);
        number* a_groups = at_least(a_groups_, groups * GROUP * FEATURES);
        float* d_features = at_least(d_features_, rows * FEATURES);
        prepare(threads);
        std::memset(d_plain + states * HIDDEN, 0, (rows - states) * HIDDEN * sizeof(number));
        std::memset(biases[3], 0, HIDDEN * sizeof(float));
        for (long i = 0; i < states; i++) {
            to_numbers(d + i * HIDDEN, d_plain + i * HIDDEN, HIDDEN);
            for (int n = 0; n < HIDDEN; n++) biases[3][n] += d[i * HIDDEN + n];
        }
        for (long i = 0; i < groups * GROUP; i++)
            for (int n = 0; n < HIDDEN; n++)
                d_groups[((n / ROWS * groups + i / GROUP) * ROWS + n % ROWS) * GROUP + i % GROUP] =
                    d_plain[i * HIDDEN + n];
        // Each share of the groups has its own sums, so that these do not depend on who is quicker.
        const long shares = std::min<long>(threads, groups);
        Deal placed(groups), panels(FEATURES / TILE), dealt(shares);
        in_threads(threads, [&](int) {
            for (long i; placed.next(i);) {
                // d is 0 beyond the last state.
                const number* first = kept_features_.data() + i * GROUP * FEATURES;
                const number* last = kept_features_.data() + std::min(i * GROUP + LAST, states - 1) * FEATURES;
                for (int f = 0; f < FEATURES; f += TILE)
                    group(first + f, last + f, a_groups + (f * groups + i * TILE) * GROUP, TILE);
            }
        });
        in_threads(threads, [&](int thread) {
            auto& dense_groups = scratch_[thread]->dense_groups;
            for (long panel; panels.next(panel);) {
                for (long n = 0; n < HIDDEN; n += GROUP)
                    group(weights_.dense[n] + panel * TILE, weights_.dense[n + LAST] + panel * TILE,
                          dense_groups[n / GROUP][0], TILE);
                for (long i = 0; i < rows; i += ROWS) {
                    Sums<ROWS> sums;
                    sums.start_at_zero();
                    sums.add(d_plain + i * HIDDEN, HIDDEN, GROUP, dense_groups[0][0], HIDDEN / GROUP);
                    sums.write(d_features + i * FEATURES + panel * TILE, FEATURES);
                }
                for (long n = 0; n < HIDDEN; n += ROWS) {
                    for (int r = 0; r < ROWS; r++)  // of the panel after this one
                        __builtin_prefetch(weights_.dense[n + r] + (panel + 1) * TILE);
                    Sums<ROWS> sums;
                    sums.start_at_zero();
                    sums.add(d_groups + n * groups * GROUP, GROUP, GROUP * ROWS,
                             a_groups + panel * TILE * groups * GROUP, groups);
                    sums.write(weights[3] + n * stride + panel * TILE, stride);
                }
            }
        });
        in_threads(threads, [&](int) {
            for (long share; dealt.next(share);) {
                std::memset(&scratch_[share]->sums, 0, sizeof(Gradients));
                for (long g = share; g < groups; g += shares)
                    add_group(pixels, states, g * GROUP, d_features, *scratch_[share]);
            }
        });
        Gradients& total = scratch_[0]->sums;
        for (long share = 1; share < shares; share++) {
            const float* more = (const float*)&scratch_[share]->sums;
            float* sums = (float*)&total;
            for (unsigned long i = 0; i < sizeof total / sizeof(float); i++) sums[i] += more[i];
        }
        std::memcpy(biases[0], total.b1, sizeof total.b1);
        std::memcpy(biases[1], total.b2, sizeof total.b2);
        std::memcpy(biases[2], total.b3, sizeof total.b3);
        for (int n = 0; n < C1; n++)
            for (int k = 0; k < K1; k++)
                weights[0][n * K1 + of_pixel(k)] = total.g1[k][n] * weights_.scale;
        for (int n = 0; n < C2; n++)
            for (int k = 0; k < K2; k++) weights[1][n * K2 + k] = total.g2[k][n];
        for (int n = 0; n < C3; n++)
            for (int k = 0; k < K3; k++) weights[2][n * K3 + k] = total.g3[k][n];
    }

  private:
    template <int OUT, int INPUTS>
    static void pack_forward(const number* rows, number (&to)[OUT / TILE][INPUTS][TILE][GROUP]) {
        for (int n = 0; n < OUT; n++)
            for (int k = 0; k < INPUTS; k++, rows += GROUP)
                std::memcpy(to[n / TILE][k][n % TILE], rows, GROUP * sizeof(number));
    }

    template <int IN, int PLACES, int OUTPUTS>
    static void pack_back(const number* rows,
                          number (&to)[IN / TILE][PLACES][OUTPUTS][TILE][GROUP]) {
        for (int n = 0; n < OUTPUTS; n++, rows += GROUP * PLACES * IN)
            for (int k = 0; k < PLACES * IN; k += TILE)
                group(rows + k, rows + LAST * PLACES * IN + k, to[k % IN / TILE][k / IN][n][0], TILE);
    }

    // Writes features as [state / TILE][group of features][state][GROUP].
    void arrange(const number* features, long states, int threads) {
        number* arranged = at_least(arranged_, ceil_div(states, TILE) * TILE * FEATURES);
        constexpr int LINES = FEATURES / LINE;  // each is read once
        Deal lines(ceil_div(states, TILE) * LINES);
        in_threads(threads, [&](int) {
            for (long line; lines.next(line);) {
                const long first = line / LINES * TILE, f = line % LINES * LINE;
                const number* from = features + first * FEATURES + f;
                number* to = arranged + first * FEATURES + f * TILE;
                const long count = std::min<long>(states - first, TILE);
                for (int g = 0; g < LINE; g += GROUP)
                    for (long i = 0; i < count; i++)
                        std::memcpy(to + g * TILE + i * GROUP, from + i * FEATURES + g,
                                    GROUP * sizeof(number));
            }
        });
    }

    void dense_few(int n, const number* features, long states, float* out) const {
        for (long i = 0; i < states; i++) {
            Sums<ROWS, 1> sums;
            sums.start_at_zero();
            for (int f = 0; f < FEATURES; f += VECTOR) {
                const auto of_state = load(features + i * FEATURES + f);
                sums.each([&](Vector& sum, int r, int) {
                    sum = add_products(sum, load(weights_.dense[n + r] + f), of_state);
                });
            }
            sums.each([&](Vector& sum, int r, int) {
                out[i * HIDDEN + n + r] = sum_of(sum) + weights_.b4[n + r];
            });
        }
    }

    void dense_many(int n, long states, float* out) const {
        for (long first = 0; first < states; first += TILE) {
            Sums<ROWS> sums;
            sums.start_at_zero();
            sums.add(weights_.dense[n], FEATURES, GROUP, arranged_.data() + first * FEATURES,
                     FEATURES / GROUP);
            float values[ROWS][TILE];
            sums.write(values[0], TILE);
            for (long i = 0; i < TILE && first + i < states; i++)
                for (int r = 0; r < ROWS; r++)
                    out[(first + i) * HIDDEN + n + r] = values[r][i] + weights_.b4[n + r];
        }
    }

    // Adds the gradients of the convolutions' weights by the group of states from `first` on. One
    // beyond the last state is that again, with gradients of 0.
    void add_group(const number* pixels, long states, long first, const float* d_features, Scratch& s) {
        const number* a0[GROUP];
        const Activations* a[GROUP];
        const float* of[GROUP];
        for (int i = 0; i < GROUP; i++) {
            const long state = std::min(first + i, states - 1);
            a0[i] = pixels + state * A0;
            a[i] = &kept_[state];
            of[i] = first + i == state ? d_features + state * FEATURES : no_gradients_;
        }
        third_layer(a, of, s);
        second_layer(weights_, a, s);
        first_layer(weights_, a0, a, s);
    }

    static void to_numbers(const float* from, number* to, int count) {
        for (int i = 0; i < count; i += LANES) store(to + i, load_vector(from + i));
    }

    void prepare(int threads) {
        while ((int)scratch_.size() < threads) {
            scratch_.push_back(std::make_unique<Scratch>());
            std::memset(scratch_.back().get(), 0, sizeof(Scratch));
        }
    }

    Weights weights_{};
    std::vector<Activations> kept_;
    std::vector<number> features_, kept_features_, arranged_, d_plain_, d_groups_, a_groups_;
    std::vector<float> d_features_;
    std::vector<std::unique_ptr<Scratch>> scratch_;
    inline static const float no_gradients_[FEATURES]{};
};

}  // namespace

extern "C" {

// Frames [states][4][84][84] as pixels [states][21][21][64]: each frame less the one before it, the
// oldest less its mean; or all less the mean of all; or as they are. Even bfloat16 has them exactly.
void trunk_pixels(const std::uint8_t* frames, number* pixels, long states, int differences, int center,
                  int threads) {
    constexpr int FRAME = SIDE * SIDE;
    Deal dealt(states);
    in_threads(threads, [&](int) {
        for (long i; dealt.next(i);) {
            const std::uint8_t* of = frames + i * FRAMES * FRAME;
            const int grey = center ? mean_of(of, (differences ? 1 : FRAMES) * FRAME) : 0;
            for (int y = 0; y < SIDE; y += BLOCK)
                for (int frame = 0; frame < FRAMES; frame++)
                    for (int x : {0, 16, 32, 48, 64, SIDE - SOME}) {  // the last ones overlap
                        const std::uint8_t* now = of + (frame * SIDE + y) * SIDE + x;
                        const bool less = differences && frame;
                        number* to = pixels + i * A0 + (y / BLOCK * S0 + x / BLOCK) * C0;
                        store_blocks(to + frame * BLOCK * BLOCK, [=](int row, int column) {
                            const std::uint8_t* at = now + row * SIDE + column;
                            return load_pixels(at) - (less ? load_pixels(at - FRAME) : all((float)grey));
                        });
                    }
        }
    });
}

Trunk* trunk_new() { return new Trunk; }

void trunk_free(Trunk* trunk) { delete trunk; }

// Takes PyTorch's weights: convolutions channels-last, rows of the dense layer `stride` apart.
void trunk_pack(Trunk* trunk, const float* const weights[4], const float* const biases[4],
                long stride, float scale, int threads) {
    trunk->pack(weights, biases, stride, scale, threads);
}

// Writes the dense layer's outputs, [states][512], and keeps what the backward pass needs.
void trunk_forward(Trunk* trunk, const number* pixels, long states, int keep, float* out,
                   int threads) {
    trunk->forward(pixels, states, keep, out, threads);
}

// Writes the gradients by all weights, laid out as for `trunk_pack`, from that by the outputs.
void trunk_backward(Trunk* trunk, const number* pixels, long states, const float* d,
                    float* const weights[4], float* const biases[4], long stride, int threads) {
    trunk->backward(pixels, states, d, weights, biases, stride, threads);
}

}  // extern "C"
