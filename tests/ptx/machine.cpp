// Executes PTX that parse.py has read: the threads of a launch one after another or as lanes that meet, and a watch over
// every byte of global memory that they read and write. ``cases.inc`` and ``meetings.inc`` come from operations.py.
#include <algorithm>
#include <cfenv>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <numeric>
#include <random>
#include <type_traits>
#include <vector>

using u8 = uint8_t; using u16 = uint16_t; using u32 = uint32_t; using u64 = uint64_t; using u128 = unsigned __int128;
using s8 = int8_t; using s16 = int16_t; using s32 = int32_t; using s64 = int64_t; using s128 = __int128;
using b8 = u8; using b16 = u16; using b32 = u32; using b64 = u64; using pred = u8; using f32 = float; using f64 = double;

// ---- as in machine.py
enum Space { GENERIC, GLOBAL, LOCAL, SHARED, PARAMETERS, CONSTANT };
enum Base { PLAIN, OF_LOCAL, OF_PARAMETERS, OF_STATIC, TID, CTAID, NTID, NCTAID, LANE, WARP, BASES };
enum Kind { RACE, MISALIGNED, OUTSIDE, MEETING, KINDS };
struct Instruction { s32 operation, guard, negated, o[8]; };
struct Constant { u64 value; s32 base, slot; };
struct Program {
    const Instruction* code;
    const Constant* constants;
    const u8 *parameters, *fixed;
    s32 count, slots, local, shared, constant, meets;
};
struct Allocation { u64 begin, end; };
struct Report { s32 kind, instruction, thread, other; u64 address; };
enum Meeting {
#include "meetings.inc"
};
struct Account { s64 found[KINDS], atomics, bytes, instructions; Report reports[8]; };

// ---- values
template <class T> T get(u64 slot) { T value; memcpy(&value, &slot, sizeof(T)); return value; }
template <class T> void put(u64& slot, T value) {
    if constexpr (std::is_integral_v<T>) slot = u64(s64(value));
    else { slot = 0; memcpy(&slot, &value, sizeof(T)); }
}
f32 flush(f32 x) { return std::fpclassify(x) == FP_SUBNORMAL ? std::copysign(0.0f, x) : x; }
f32 flushed(u64 slot) { return flush(get<f32>(slot)); }
void put_flushed(u64& slot, f32 x) { put<f32>(slot, flush(x)); }
template <class T, class F> __attribute__((noinline)) T rounded(int mode, F f) {
    fesetround(mode);
    volatile T value = f();
    fesetround(FE_TONEAREST);
    return value;
}
template <class I, class F> I whole(F x) {
    if (x != x) return sizeof(F) == 8 || sizeof(I) == 8 ? I(u64(1) << (8 * sizeof(I) - 1)) : I(0);
    if (x <= F(std::numeric_limits<I>::min())) return std::numeric_limits<I>::min();
    return x >= F(std::numeric_limits<I>::max()) ? std::numeric_limits<I>::max() : I(x);
}
f64 upper_half(f64 x) { return get<f64>(b64(reinterpret_cast<u64&>(x)) >> 32 << 32); }
template <class T> u32 highest(T x) {
    if (x < 0) x = ~x;
    return x == 0 ? ~0u : 63 - __builtin_clzll(std::make_unsigned_t<T>(x));
}
template <class T> T reversed(T x) {
    T out = 0;
    for (u32 k = 0; k < 8 * sizeof(T); ++k) out |= (x >> k & 1) << (8 * sizeof(T) - 1 - k);
    return out;
}
template <class T> T field(T x, u32 at, u32 length) {
    const u32 width = 8 * sizeof(T), top = std::min(at + length, width) - 1;
    T out = 0;
    for (u32 k = 0; k < width && length > 0; ++k) {
        const bool sign = x < 0 || T(-1) < 0 ? x >> top & 1 : 0;
        out |= T(k < length && at + k < width ? x >> (at + k) & 1 : sign) << k;
    }
    return out;
}
template <class T> T inserted(T field, T into, u32 at, u32 length) {
    for (u32 k = 0; k < length && at + k < 8 * sizeof(T); ++k)
        into = (into & ~(T(1) << (at + k))) | (field >> k & 1) << (at + k);
    return into;
}
u32 permuted(u64 bytes, u32 choice) {
    u32 out = 0;
    for (int k = 0; k < 4; ++k) {
        const u32 which = choice >> 4 * k & 15, byte = bytes >> 8 * (which & 7) & 255;
        out |= (which & 8 ? byte & 128 ? 255 : 0 : byte) << 8 * k;
    }
    return out;
}
u32 looked_up(u32 a, u32 b, u32 c, u32 table) {
    u32 out = 0;
    for (int k = 0; k < 32; ++k) out |= (table >> ((a >> k & 1) << 2 | (b >> k & 1) << 1 | (c >> k & 1)) & 1) << k;
    return out;
}

// ---- threads
struct Thread {
    u64* slots;
    u8* local;
    s32 number, at, meets;  // ``meets``: the operation at which it waits for others, or -1
    const Instruction* waits;
    bool left, carry;
};

enum Access { WRITES, READS, CHANGES, ACCESSES };
constexpr u32 NOBODY = 0, SEVERAL = ~0u;
struct Shadow { u32* users[ACCESSES]; };  // of each byte, who wrote it, read it, and changed it atomically: threads from 1

struct Machine {
    const Program& program;
    Account& account;
    std::vector<Allocation> allocations;
    std::vector<Shadow> shadows;
    std::vector<u8> shared;
    size_t last = 0;

    // ---- watch
    void report(Kind kind, const Thread& t, u64 address, u32 other = 0) {
        const s64 place = std::accumulate(account.found, account.found + KINDS, s64(0));
        ++account.found[kind];
        if (place < 8) account.reports[place] = {kind, t.at - 1, t.number, s32(other) - 1, address};
    }

    bool inside(size_t which, u64 address, int size) const {
        return which < allocations.size() && address >= allocations[which].begin && address + size <= allocations[which].end;
    }

    // Whether a thread may have these bytes; two threads race for one unless both read it or both change it atomically.
    bool watched(const Thread& t, u64 address, int size, Access access) {
        if (address % size) return report(MISALIGNED, t, address), false;
        if (!inside(last, address, size)) {
            const auto after = std::upper_bound(allocations.begin(), allocations.end(), address,
                                                [](u64 place, const Allocation& each) { return place < each.begin; });
            last = after - allocations.begin() - 1;
            if (!inside(last, address, size)) return report(OUTSIDE, t, address), false;
        }
        account.bytes += size;
        const u64 first = address - allocations[last].begin;
        const Shadow& shadow = shadows[last];
        u32 *const written = shadow.users[WRITES] + first, *const read = shadow.users[READS] + first;
        u32 *const changed = shadow.users[CHANGES] + first, own = t.number + 1;
        const auto other = [own](u32 user) -> u32 { return user == own ? NOBODY : user; };
        u32 who = NOBODY;
        for (int k = 0; k < size; ++k)
            who |= other(written[k]) | (access == READS ? 0 : other(read[k])) | (access == CHANGES ? 0 : other(changed[k]));
        if (who) report(RACE, t, address, who);
        u32* const users = shadow.users[access] + first;
        for (int k = 0; k < size; ++k) users[k] = other(users[k]) ? SEVERAL : own;
        return true;
    }

    // Where the bytes of an access are in the host's memory, or null where there are none.
    u8* place(Thread& t, const s32* o, int size, Access access) {
        const u64 address = t.slots[o[4]] + s64(o[5]);
        const auto within = [&](const u8* memory, s32 bytes) {
            return address >= u64(memory) && address + size <= u64(memory) + bytes;
        };
        const bool own = within(t.local, program.local);
        switch (o[7]) {
            case SHARED: {
                const u32 at = address;
                if (at % size) return report(MISALIGNED, t, address), nullptr;
                if (at + size > shared.size()) return report(OUTSIDE, t, address), nullptr;
                return shared.data() + at;
            }
            case PARAMETERS: case CONSTANT: return (u8*)address;
            case LOCAL: if (!own) return report(OUTSIDE, t, address), nullptr;
        }
        if (access == READS && within(program.fixed, program.constant)) return (u8*)address;
        return own || watched(t, address, size, access) ? (u8*)address : nullptr;
    }

    template <class T> void load(Thread& t, const s32* o) {
        const u8* from = place(t, o, sizeof(T) * o[6], READS);
        for (int k = 0; k < o[6]; ++k) {
            T value{};
            if (from) memcpy(&value, from + k * sizeof(T), sizeof(T));
            put<T>(t.slots[o[k]], value);
        }
    }
    template <class T> void store(Thread& t, const s32* o) {
        u8* to = place(t, o, sizeof(T) * o[6], WRITES);
        for (int k = 0; to && k < o[6]; ++k) {
            const T value = get<T>(t.slots[o[k]]);
            memcpy(to + k * sizeof(T), &value, sizeof(T));
        }
    }
    template <class T, class F> void change(Thread& t, const s32* o, F changed) {
        T before{};
        ++account.atomics;
        if (u8* at = place(t, o, sizeof(T), CHANGES)) {
            memcpy(&before, at, sizeof(T));
            const T after = changed(before, get<T>(t.slots[o[1]]), get<T>(t.slots[o[2]]));
            memcpy(at, &after, sizeof(T));
        }
        put<T>(t.slots[o[0]], before);
    }

    template <class T> T sum(Thread& t, T x, T y, bool with_carry, bool leaves_one) {
        T all;
        bool over = __builtin_add_overflow(x, y, &all);
        if (with_carry) over |= __builtin_add_overflow(all, T(t.carry), &all);
        if (leaves_one) t.carry = over;
        return all;
    }

    template <class T> T difference(Thread& t, T x, T y, bool with_borrow, bool leaves_one) {
        T rest;
        bool under = __builtin_sub_overflow(x, y, &rest);
        if (with_borrow) under |= __builtin_sub_overflow(rest, T(t.carry), &rest);
        if (leaves_one) t.carry = under;
        return rest;
    }

    // ---- execution
    void start(Thread& t, s32 tid, s32 block, s32 grid, s32 size) {
        const u64 base[BASES] = {0, u64(t.local), u64(program.parameters), u64(program.fixed), u64(tid), u64(block),
                                 u64(size), u64(grid), u64(tid % 32), u64(tid / 32)};
        std::fill(t.slots, t.slots + program.slots, 0);
        for (int k = 0; k < program.count; ++k) {
            const Constant& each = program.constants[k];
            t.slots[each.slot] = each.value + base[each.base];
        }
        t.number = block * size + tid, t.at = 0, t.meets = -1, t.left = t.carry = false;
    }

    // Runs a thread until it leaves or meets others.
    void run(Thread& t) {
        u64* const R = t.slots;
        for (s64 done = 1;; ++done) {
            const Instruction& each = program.code[t.at++];
            const s32* const o = each.o;
            if (each.guard >= 0 && bool(R[each.guard]) == bool(each.negated)) continue;
            switch (each.operation) {
#include "cases.inc"
            }
        }
    }

    // ---- meetings
    // A meeting's operands: results o[0] and o[1], the lane's own value o[2], further ones, and the lanes' mask o[7].
    static u32 named(const Thread& t) { return get<u32>(t.slots[t.waits->o[7]]); }

    static bool complete(const Thread* warp, int lane, int lanes) {
        const u32 mask = named(warp[lane]);
        for (int k = 0; k < 32; ++k) {
            if (!(mask >> k & 1)) continue;
            if (k >= lanes || warp[k].left || warp[k].meets != warp[lane].meets || named(warp[k]) != mask) return false;
        }
        return mask >> lane & 1;
    }

    // Gives every lane of a meeting what it gets of the others' values.
    void exchange(Thread* warp, u32 mask) {
        std::vector<u64> all;
        u64 value[32] = {};
        u32 ballot = 0;
        for (int k = 0; k < 32; ++k) {
            if (!(mask >> k & 1)) continue;
            value[k] = warp[k].slots[warp[k].waits->o[2]];
            ballot |= u32(bool(value[k])) << k;
            all.push_back(value[k]);
        }
        const auto folded = [&](auto type, auto fold) {
            using T = decltype(type);
            T result = get<T>(all[0]);
            for (size_t k = 1; k < all.size(); ++k) result = fold(result, get<T>(all[k]));
            return u64(result);
        };
        const auto least = [](auto a, auto b) { return a < b ? a : b; };
        const auto most = [](auto a, auto b) { return a > b ? a : b; };
        for (int k = 0; k < 32; ++k) {
            if (!(mask >> k & 1)) continue;
            Thread& t = warp[k];
            u64 &result = t.slots[t.waits->o[0]], &also = t.slots[t.waits->o[1]];
            switch (t.meets) {
                case SHFL_SYNC_UP_B32: case SHFL_SYNC_DOWN_B32: case SHFL_SYNC_BFLY_B32: case SHFL_SYNC_IDX_B32:
                    result = shuffled(t, k, value, mask, also);
                    break;
                case VOTE_SYNC_ALL_PRED: result = ballot == mask; break;
                case VOTE_SYNC_ANY_PRED: result = ballot != 0; break;
                case VOTE_SYNC_UNI_PRED: result = ballot == mask || ballot == 0; break;
                case VOTE_SYNC_BALLOT_B32: result = ballot; break;
                case MATCH_ANY_SYNC_B32: case MATCH_ANY_SYNC_B64:
                    result = 0;
                    for (int other = 0; other < 32; ++other)
                        result |= u64((mask >> other & 1) && value[other] == value[k]) << other;
                    break;
                case MATCH_ALL_SYNC_B32: case MATCH_ALL_SYNC_B64:
                    also = std::count(all.begin(), all.end(), all[0]) == s64(all.size());
                    result = also ? mask : 0;
                    break;
                case REDUX_SYNC_ADD_U32: case REDUX_SYNC_ADD_S32:
                    result = folded(u32(), [](u32 a, u32 b) { return a + b; });
                    break;
                case REDUX_SYNC_MIN_U32: result = folded(u32(), least); break;
                case REDUX_SYNC_MIN_S32: result = folded(s32(), least); break;
                case REDUX_SYNC_MAX_U32: result = folded(u32(), most); break;
                case REDUX_SYNC_MAX_S32: result = folded(s32(), most); break;
                case REDUX_SYNC_AND_B32: result = folded(u32(), [](u32 a, u32 b) { return a & b; }); break;
                case REDUX_SYNC_OR_B32: result = folded(u32(), [](u32 a, u32 b) { return a | b; }); break;
                case REDUX_SYNC_XOR_B32: result = folded(u32(), [](u32 a, u32 b) { return a ^ b; }); break;
            }
            t.meets = -1;
        }
    }

    u64 shuffled(Thread& t, int lane, const u64* value, u32 mask, u64& within) {
        const u32 b = t.slots[t.waits->o[3]] & 31, c = t.slots[t.waits->o[4]], segment = c >> 8 & 31;
        const int first = lane & segment, last = first | (c & ~segment & 31);
        int from = t.meets == SHFL_SYNC_UP_B32 ? lane - int(b)
            : t.meets == SHFL_SYNC_DOWN_B32 ? lane + int(b)
            : t.meets == SHFL_SYNC_BFLY_B32 ? lane ^ int(b) : first | int(b & ~segment);
        within = t.meets == SHFL_SYNC_UP_B32 ? from >= last : from <= last;
        if (!within) from = lane;
        if (!(mask >> from & 1)) report(MEETING, t, 0, t.number - lane + from + 1);
        return value[from];
    }

    // Completes what can be; whether any thread goes on. Threads whose meeting never completes are reported and end.
    bool meet_all(std::vector<Thread>& threads) {
        const int size = threads.size();
        bool on = false, barrier = true;
        for (int k = 0; k < size; ++k) {
            const Thread& t = threads[k];
            barrier &= t.left || t.meets == BAR_SYNC;
            Thread* const warp = threads.data() + k / 32 * 32;
            if (t.left || t.meets < 0 || t.meets == BAR_SYNC || !complete(warp, k % 32, size - k / 32 * 32)) continue;
            exchange(warp, named(t));
            on = true;
        }
        for (Thread& t : threads) {
            if (on || t.left) continue;
            if (!barrier) report(MEETING, t, 0), t.left = true;
            t.meets = -1;
        }
        return on || std::any_of(threads.begin(), threads.end(), [](const Thread& t) { return !t.left; });
    }

    void whole_block(std::vector<Thread>& threads, std::vector<s32>& order, std::mt19937& chance) {
        for (bool on = true; on;) {
            std::shuffle(order.begin(), order.end(), chance);
            for (const s32 each : order)
                if (Thread& t = threads[each]; !t.left && t.meets < 0) run(t);
            on = meet_all(threads);
        }
    }
};

extern "C" void execute(const Program* program, const Allocation* allocations, int count, int grid, int size, int seed,
                        Account* account) {
    Machine machine{*program, *account, {allocations, allocations + count}, {}, std::vector<u8>(program->shared)};
    for (const Allocation& each : machine.allocations)
        for (u32*& users : machine.shadows.emplace_back().users) users = (u32*)calloc(each.end - each.begin, sizeof(u32));
    const size_t together = program->meets ? size : 1;
    std::vector<u64> slots(together * program->slots), locals(together * (program->local / 8 + 2));
    std::vector<Thread> threads(together);
    for (size_t k = 0; k < together; ++k) {
        threads[k].slots = slots.data() + k * program->slots;
        threads[k].local = (u8*)((u64(locals.data() + k * (program->local / 8 + 2)) + 15) / 16 * 16);
    }
    std::mt19937 chance(seed);
    std::vector<s32> blocks(grid), order(size);
    std::iota(blocks.begin(), blocks.end(), 0);
    std::iota(order.begin(), order.end(), 0);
    std::shuffle(blocks.begin(), blocks.end(), chance);
    for (const s32 block : blocks) {
        std::fill(machine.shared.begin(), machine.shared.end(), 0xcd);
        if (program->meets) {
            for (s32 tid = 0; tid < size; ++tid) machine.start(threads[tid], tid, block, grid, size);
            machine.whole_block(threads, order, chance);
            continue;
        }
        std::shuffle(order.begin(), order.end(), chance);
        for (const s32 tid : order) {
            machine.start(threads[0], tid, block, grid, size);
            machine.run(threads[0]);
        }
    }
    for (const Shadow& each : machine.shadows)
        for (u32* users : each.users) free(users);
}
