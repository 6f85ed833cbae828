"""The executor of PTX finds faults that are planted in small kernels, finds none in their repaired twins, and computes
what PTX's operations are defined to compute."""

import struct

import numpy as np
import pytest

from ptx.machine import KINDS, Account, Executable
from ptx.parse import UnknownPtx, parsed

KERNEL = """
.version 8.0
.target sm_80
.address_size 64
.visible .entry planted(.param .u64 planted_0)
{{
    .reg .pred %p<4>;
    .reg .b16 %rs<4>;
    .reg .b32 %r<16>;
    .reg .f32 %f<16>;
    .reg .b64 %rd<8>;
    .reg .f64 %fd<4>;
    ld.param.u64 %rd1, [planted_0];
    cvta.to.global.u64 %rd2, %rd1;
    mov.u32 %r1, %tid.x;
    mul.wide.u32 %rd3, %r1, 4;
    add.s64 %rd4, %rd2, %rd3;
    {body}
    ret;
}}
"""
"""A kernel with an array of 64 numbers: %rd2 is its address, %r1 the thread, and %rd4 the thread's entry."""

PLAIN_SUM = "ld.global.f32 %f8, [{to}]; add.f32 %f9, %f8, {what}; st.global.f32 [{to}], %f9;"
ATOMIC_SUM = "red.global.add.f32 [{to}], {what};"

OWN_OF_FOUR = "and.b32 %r2, %r1, 3; mul.wide.u32 %rd5, %r2, 4; add.s64 %rd6, %rd2, %rd5;"

SUM_OF_A_WARP = "mov.f32 %f1, 0f3F800000;" + "".join(
    f"mov.b32 %r3, %f1; shfl.sync.bfly.b32 %r4|%p1, %r3, {apart}, 31, -1; mov.b32 %f2, %r4; add.f32 %f1, %f1, %f2;"
    for apart in (16, 8, 4, 2, 1)
)

ONE_OF_A_WARP = "and.b32 %r5, %r1, 31; setp.ne.u32 %p2, %r5, 0; @%p2 bra $DONE; {sum} $DONE:"

HALF_LEAVES = "and.b32 %r5, %r1, 31; setp.ge.u32 %p2, %r5, 16; @%p2 ret; shfl.sync.bfly.b32 %r6, %r1, 1, 31, {mask};"

FAULTS = {
    "race": (
        OWN_OF_FOUR + PLAIN_SUM.format(to="%rd6", what="0f3F800000"),
        OWN_OF_FOUR + ATOMIC_SUM.format(to="%rd6", what="0f3F800000"),
    ),
    "race between warps": (
        SUM_OF_A_WARP + ONE_OF_A_WARP.format(sum=PLAIN_SUM.format(to="%rd2", what="%f1")),
        SUM_OF_A_WARP + ONE_OF_A_WARP.format(sum=ATOMIC_SUM.format(to="%rd2", what="%f1")),
    ),
    "misaligned": ("ld.global.f32 %f1, [%rd2+6];", "ld.global.f32 %f1, [%rd2+4];"),
    "outside": ("st.global.u32 [%rd4+4], %r1;", "setp.lt.u32 %p1, %r1, 63; @%p1 st.global.u32 [%rd4+4], %r1;"),
    "order": ("atom.global.exch.b32 %r2, [%rd2], %r1;", "atom.global.max.u32 %r2, [%rd2], %r1;"),
    "meeting": (HALF_LEAVES.format(mask="-1"), HALF_LEAVES.format(mask="65535")),
}
"""By the kind of a fault, the body of a kernel that has it and of one that has not."""


def run(body: str, seed: int = 0) -> tuple[np.ndarray, Account]:
    """The array after 64 threads, and what they did."""
    array, account = np.zeros(64, np.uint32), Account()
    begin = array.ctypes.data
    kernel = Executable(parsed(KERNEL.format(body=body)), "planted")
    kernel.execute_twice([struct.pack("Q", begin)], [(begin, begin + array.nbytes)], (1, 64), seed, account)
    return array, account


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_is_found_and_nothing_in_its_repaired_twin(fault: str, seed: int) -> None:
    faulty, repaired = (run(body, seed)[1] for body in FAULTS[fault])
    assert [kind for kind in (*KINDS, "order") if faulty.found[kind]] == [fault.split()[0]]
    assert faulty.reports
    assert not any(repaired.found.values())


@pytest.mark.slow
def test_lanes_that_meet_add_up_and_only_one_of_a_warp_changes_memory() -> None:
    array, account = run(FAULTS["race between warps"][1])
    assert array.view(np.float32)[0] == 64
    assert account.atomics.total() == 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("vote.sync.ballot.b32 %r2, %p1, -1;", 0b1000),
        ("not.pred %p2, %p1; vote.sync.all.pred %p3, %p2, -1; selp.u32 %r2, 5, 7, %p3;", 7),
        ("vote.sync.any.pred %p3, %p1, -1; selp.u32 %r2, 5, 7, %p3;", 5),
        ("redux.sync.add.u32 %r2, %r9, -1;", 496),
        ("neg.s32 %r8, %r9; redux.sync.min.s32 %r2, %r8, -1;", -31 & 2**32 - 1),
        ("and.b32 %r8, %r9, 15; match.any.sync.b32 %r2, %r8, -1;", 0b1000_0000_0000_0000_1000),
        ("shfl.sync.idx.b32 %r2, %r9, 7, 31, -1;", 7),
        ("shfl.sync.up.b32 %r2, %r9, 2, 0, -1;", 1),
        ("shfl.sync.down.b32 %r2|%p2, %r9, 30, 31, -1;", 3),
        ("bar.warp.sync -1; bar.sync 0; mov.u32 %r2, 9;", 9),
    ],
)
def test_shuffles_of_lanes_follow_ptx(body: str, expected: int) -> None:
    """At lane 3, which alone has %p1."""
    place = "mov.u32 %r9, %laneid; setp.eq.u32 %p1, %r9, 3;"
    array, account = run(f"{place} {body} st.global.u32 [%rd4], %r2;")
    assert array[3] == expected
    assert not any(account.found.values())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("mov.f32 %f1, 0f7FC00000; cvt.rzi.s32.f32 %r2, %f1;", 0),  # not a number
        ("mov.f32 %f1, 0f4F32D05E; cvt.rzi.s32.f32 %r2, %f1;", 2**31 - 1),  # 3e9
        ("mov.f32 %f1, 0fBF800000; cvt.rzi.u32.f32 %r2, %f1;", 0),
        ("mov.f32 %f1, 0f40200000; cvt.rni.s32.f32 %r2, %f1;", 2),  # 2.5
        ("mov.f32 %f1, 0f7FC00000; max.f32 %f2, %f1, 0f3F800000; mov.b32 %r2, %f2;", 0x3F800000),
        ("mov.f32 %f1, 0f00000001; ex2.approx.ftz.f32 %f2, %f1; mov.b32 %r2, %f2;", 0x3F800000),
        ("mov.f32 %f1, 0f00000001; mul.ftz.f32 %f2, %f1, %f1; mov.b32 %r2, %f2;", 0),
        ("fma.rm.f32 %f2, 0f3F800001, 0f3F800001, 0f00000000; mov.b32 %r2, %f2;", 0x3F800002),
        ("fma.rp.f32 %f2, 0f3F800001, 0f3F800001, 0f00000000; mov.b32 %r2, %f2;", 0x3F800003),
        # In one step.
        ("mul.f32 %f1, 0f3F800001, 0f3F800001; sub.f32 %f2, %f1, 0f3F800002; mov.b32 %r2, %f2;", 0x28800000),
        ("mul.rn.f32 %f1, 0f3F800001, 0f3F800001; sub.f32 %f2, %f1, 0f3F800002; mov.b32 %r2, %f2;", 0),
        ("mov.f32 %f1, 0f7FC00000; setp.ne.f32 %p1, %f1, %f1; selp.u32 %r2, 1, 2, %p1;", 2),
        ("setp.lt.and.s32 %p1, -1, 0, %p2; selp.u32 %r2, 1, 2, %p1;", 2),
        ("mov.u32 %r3, 1; shl.b32 %r2, %r3, 40;", 0),
        ("mov.u32 %r3, 0x80000000; shr.s32 %r2, %r3, 40;", 2**32 - 1),
        ("mov.u32 %r3, -1; mul.hi.u32 %r2, %r3, %r3;", 2**32 - 2),
        ("mov.u32 %r3, 7; div.u32 %r2, %r3, 0;", 2**32 - 1),
        ("mov.u32 %r3, -1; add.cc.u32 %r4, %r3, 1; addc.u32 %r2, 0, 5;", 6),
        ("mov.u32 %r3, 0x12345678; prmt.b32 %r2, %r3, 0, 0x0123;", 0x78563412),
        ("mov.u32 %r3, 0x12345678; brev.b32 %r2, %r3;", 0x1E6A2C48),
        ("mov.u32 %r3, 0xF0; bfe.s32 %r2, %r3, 4, 4;", 2**32 - 1),
        ("mov.u32 %r3, 0x100; bfind.shiftamt.u32 %r2, %r3;", 23),
        ("mov.u32 %r3, 0x80000000; mov.u32 %r4, 2; shf.l.wrap.b32 %r2, %r3, %r4, 33;", 5),
        ("lop3.b32 %r2, 12, 10, 6, 0x96;", 12 ^ 10 ^ 6),
        ("{ .reg .b32 %r1; mov.u32 %r1, 8; } mov.u32 %r2, 4;", 4),
    ],
)
def test_operations_follow_ptx(body: str, expected: int) -> None:
    array, _ = run(f"{body} st.global.u32 [%rd4], %r2;")
    assert set(array) == {expected}


@pytest.mark.parametrize("instruction", ["activemask.b32 %r2", "wmma.load %r2", "mov.u32 %r2, %clock", "call (%r2), f"])
def test_an_instruction_that_the_machine_does_not_know_is_refused_by_its_text(instruction: str) -> None:
    with pytest.raises(UnknownPtx, match=instruction.split()[-1]):
        parsed(KERNEL.format(body=f"{instruction};"))
