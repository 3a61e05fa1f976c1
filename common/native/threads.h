// Work that is dealt out to threads.

#pragma once

#include <atomic>
#include <thread>
#include <vector>

// The OpenMP threads of PyTorch, if it has loaded them: they are awake already, and threads of our
// own would have to share the cores with them.
extern "C" [[gnu::weak]] void GOMP_parallel(void (*)(void*), void*, unsigned, unsigned);

// Runs work(thread) in so many threads, or in fewer, and returns when all are done.
template <class F>
void in_threads(int threads, const F& work) {
    struct Team {
        const F& work;
        std::atomic<int> next{0};
        static void join(void* team) { ((Team*)team)->work(((Team*)team)->next++); }
    } team{work};
    if (threads == 1) return work(0);
    if (GOMP_parallel) return GOMP_parallel(Team::join, &team, threads, 0);
    std::vector<std::thread> others;
    for (int i = 1; i < threads; i++) others.emplace_back(Team::join, &team);
    Team::join(&team);
    for (auto& each : others) each.join();
}

// Deals 0 to count - 1 out to threads.
class Deal {
  public:
    explicit Deal(long count) : count_(count) {}
    bool next(long& i) { return (i = next_.fetch_add(1, std::memory_order_relaxed)) < count_; }

  private:
    std::atomic<long> next_{0};
    const long count_;
};
