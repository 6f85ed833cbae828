"""A table of PTX's operations and their results, of which ``cases`` makes the cases of the machine's switch.

A row has an operation's name without its type, the types that it has, the type of its result and of its sources (T: the
operation's own type, W: the type of twice its width), and the result as C++ of the sources a, b, c and d. Source: PTX
ISA 9.x, chapter Instruction Set. Approximate operations are computed as exactly as the others.
"""

import re
from collections.abc import Iterator
from typing import NamedTuple

INTEGERS = "u16 u32 u64 s16 s32 s64"
FLOATS = "f32 f64"
BITS = "b16 b32 b64"
ANY = f"{INTEGERS} {FLOATS} {BITS} pred"
WHOLE = "u8 u16 u32 u64 s8 s16 s32 s64"
WIDER = {"u16": "u32", "u32": "u64", "s16": "s32", "s32": "s64", "u64": "u128", "s64": "s128"}
MODES = {"rz": "FE_TOWARDZERO", "rm": "FE_DOWNWARD", "rp": "FE_UPWARD"}
TO_WHOLE = {"rzi": "trunc", "rni": "nearbyint", "rmi": "floor", "rpi": "ceil"}

ARITHMETIC = {"add": "a + b", "sub": "a - b", "mul": "a * b", "fma": "std::fma(T(a), T(b), T(c))",
              "div": "a / b", "sqrt": "std::sqrt(T(a))", "rcp": "1 / a"}  # fmt: skip
"""Operations of floats that round, each in every mode."""

CARRYING = (
    ("add", "", "sum", "a, b"), ("sub", "", "difference", "a, b"), ("mad", ".lo", "sum", "T(a * b), c"),
    ("mad", ".hi", "sum", "T((W(a) * W(b)) >> (8 * sizeof(T))), c"),
)  # fmt: skip
"""Sums and differences that take a carry bit (addc) or leave one (.cc)."""

ORDERED = {"eq": "a == b", "ne": "a < b || a > b", "lt": "a < b", "le": "a <= b", "gt": "a > b", "ge": "a >= b"}
UNORDERED = {"equ": "!(a < b || a > b)", "neu": "a != b", "ltu": "!(a >= b)", "leu": "!(a > b)", "gtu": "!(a <= b)",
             "geu": "!(a < b)", "num": "a == a && b == b", "nan": "a != a || b != b"}  # fmt: skip

ROWS = (
    ("mov", ANY, "T", "T", "a"),
    ("cvta", "u64", "T", "T", "a"),
    *((name, FLOATS, "T", "TTT"[: 3 if name == "fma" else 1 if name in ("sqrt", "rcp") else 2], text)
      for name, text in ARITHMETIC.items()),
    *((name, INTEGERS, "T", "TT", ARITHMETIC[name]) for name in ("add", "sub")),
    ("fms", FLOATS, "T", "TTT", "std::fma(a, b, -c)"),  # these two stand for PTX that is contracted
    ("fnma", FLOATS, "T", "TTT", "std::fma(-a, b, c)"),
    ("mul.lo", INTEGERS, "T", "TT", "a * b"),
    ("mul.hi", INTEGERS, "T", "TT", "(W(a) * W(b)) >> (8 * sizeof(T))"),
    ("mul.wide", "u16 u32 s16 s32", "W", "TT", "W(a) * W(b)"),
    ("mad.lo", INTEGERS, "T", "TTT", "a * b + c"),
    ("mad.hi", INTEGERS, "T", "TTT", "T((W(a) * W(b)) >> (8 * sizeof(T))) + c"),
    ("mad.wide", "u16 u32 s16 s32", "W", "TTW", "W(a) * W(b) + c"),
    *((f"{name}{c}{part}{cc}", "u32 u64", "T", "TTT"[: 3 if part else 2],
       f"{function}<T>(t, {text}, {bool(c):d}, {bool(cc):d})")
      for name, part, function, text in CARRYING for c in ("", "c") for cc in ("", ".cc") if c or cc),
    ("div", INTEGERS, "T", "TT", "b == 0 ? T(-1) : b == T(-1) && T(-1) < 0 ? -a : a / b"),
    ("rem", INTEGERS, "T", "TT", "b == 0 ? a : b == T(-1) && T(-1) < 0 ? 0 : a % b"),
    ("neg", f"s16 s32 s64 {FLOATS}", "T", "T", "-a"),
    ("abs", "s16 s32 s64", "T", "T", "a < 0 ? -a : a"),
    ("abs", FLOATS, "T", "T", "std::fabs(a)"),
    ("min", INTEGERS, "T", "TT", "a < b ? a : b"),
    ("max", INTEGERS, "T", "TT", "a > b ? a : b"),
    ("min", FLOATS, "T", "TT", "a != a ? b : a < b || b != b || (a == b && std::signbit(a)) ? a : b"),
    ("max", FLOATS, "T", "TT", "a != a ? b : a > b || b != b || (a == b && !std::signbit(a)) ? a : b"),
    ("copysign", FLOATS, "T", "TT", "std::copysign(b, a)"),
    ("rsqrt", FLOATS, "T", "T", "1 / std::sqrt(a)"),
    ("rcp.ftz", "f64", "T", "T", "upper_half(1 / upper_half(a))"),
    ("rsqrt.ftz", "f64", "T", "T", "upper_half(1 / std::sqrt(upper_half(a)))"),
    *((name, "f32", "T", "T", f"std::{function}(a)") for name, function in
      {"ex2": "exp2", "lg2": "log2", "sin": "sin", "cos": "cos", "tanh": "tanh"}.items()),
    *((f"testp.{name}", FLOATS, "pred", "T", text) for name, text in
      {"finite": "std::isfinite(a)", "infinite": "std::isinf(a)", "notanumber": "a != a", "number": "a == a",
       "normal": "std::isnormal(a)"}.items()),
    *((f"setp.{name}", f"{INTEGERS} {BITS}", "pred", "TT", text) for name, text in
      (ORDERED | {"lo": "a < b", "ls": "a <= b", "hi": "a > b", "hs": "a >= b"}).items()),
    *((f"setp.{name}", FLOATS, "pred", "TT", text) for name, text in (ORDERED | UNORDERED).items()),
    ("selp", ANY, "T", "TTp", "c ? a : b"),
    ("and", f"{BITS} pred", "T", "TT", "a & b"),
    ("or", f"{BITS} pred", "T", "TT", "a | b"),
    ("xor", f"{BITS} pred", "T", "TT", "a ^ b"),
    ("not", BITS, "T", "T", "~a"),
    ("not", "pred", "T", "T", "!a"),
    ("shl", BITS, "T", "Tu", "b < 8 * sizeof(T) ? a << b : 0"),
    ("shr", f"{BITS} {INTEGERS}", "T", "Tu", "b < 8 * sizeof(T) ? a >> b : a < 0 ? -1 : 0"),
    ("shf.l.wrap", "b32", "T", "TTu", "(u64(b) << 32 | a) << (c & 31) >> 32"),
    ("shf.r.wrap", "b32", "T", "TTu", "(u64(b) << 32 | a) >> (c & 31)"),
    ("shf.l.clamp", "b32", "T", "TTu", "c < 32 ? (u64(b) << 32 | a) << c >> 32 : a"),
    ("shf.r.clamp", "b32", "T", "TTu", "(u64(b) << 32 | a) >> (c < 32 ? c : 32)"),
    ("bfe", "u32 u64 s32 s64", "T", "Tuu", "field<T>(a, b & 255, c & 255)"),
    ("bfi", "b32 b64", "T", "TTuu", "inserted<T>(a, b, c & 255, d & 255)"),
    ("bfind", "u32 u64 s32 s64", "u32", "T", "highest<T>(a)"),
    ("bfind.shiftamt", "u32 u64 s32 s64", "u32", "T", "highest<T>(a) == ~0u ? ~0u : 8 * sizeof(T) - 1 - highest<T>(a)"),
    ("popc", "b32 b64", "u32", "T", "__builtin_popcountll(a)"),
    ("clz", "b32 b64", "u32", "T", "8 * sizeof(T) - 1 - highest<T>(a)"),
    ("brev", "b32 b64", "T", "T", "reversed<T>(a)"),
    ("prmt", "b32", "T", "TTu", "permuted(u64(b) << 32 | a, c)"),
    ("lop3", "b32", "T", "TTTu", "looked_up(a, b, c, d)"),
    ("pack", "b32", "T", "hh", "a | u32(b) << 16"),
    ("pack", "b64", "T", "uu", "a | u64(b) << 32"),
)  # fmt: skip

MEETINGS = (
    *(f"shfl.sync.{mode}.b32" for mode in ("up", "down", "bfly", "idx")),
    *(f"vote.sync.{mode}.pred" for mode in ("all", "any", "uni")), "vote.sync.ballot.b32",
    *(f"match.{mode}.sync.{kind}" for mode in ("any", "all") for kind in ("b32", "b64")),
    *(f"redux.sync.{what}.{kind}" for what in ("add", "min", "max") for kind in ("u32", "s32")),
    *(f"redux.sync.{what}.b32" for what in ("and", "or", "xor")),
    "bar.warp.sync", "bar.sync",
)  # fmt: skip
"""Operations at which the lanes of a warp meet, and at last the threads of a block."""

CHANGES = {
    "add": "x + b", "min": "b < x ? b : x", "max": "b > x ? b : x", "exch": "b", "cas": "x == b ? c : x",
    "and": "x & b", "or": "x | b", "xor": "x ^ b",
}  # fmt: skip
"""Atomic operations: what becomes of a value x in memory."""


class Case(NamedTuple):
    """A case of the machine's switch."""

    name: str
    """The operation as ``plain_name`` writes it."""
    text: str
    """C++ that takes its operands from ``o``."""


def plain_name(opcode: str) -> str:
    """An operation's name without words that mean nothing here: how exact, how cached, atomic for whom."""
    name = re.sub(
        r"\.(?:uni|nc|volatile|weak|relaxed|acquire|release|acq_rel|gpu|sys|cta|approx|full|aligned)(?=\.|$)",
        "",
        opcode,
    )
    if name.startswith("cvta.") and "shared" not in name:
        return "cvta.u64"  # spaces other than shared memory have the host's addresses
    return name if name.startswith("cvt.") else re.sub(r"\.rn(?=\.|$)", "", name)


def cases() -> Iterator[Case]:
    """All operations that the machine knows; a case's number is its place."""
    for name, kinds, result, sources, text in ROWS:
        for kind in kinds.split():
            yield _plain(f"{name}.{kind}", kind, result, sources, text)
            if kind == "f32":
                flushed = _plain(f"{name}.ftz.f32", kind, result, sources, text).text
                yield Case(f"{name}.ftz.f32", flushed.replace("get<f32>", "flushed").replace("put<f32>", "put_flushed"))
            if kind in FLOATS and name in ARITHMETIC:
                for mode, number in MODES.items():
                    exact = f"rounded<T>({number}, [&] {{ return T({text}); }})"
                    made = _plain(f"{name}.{mode}.{kind}", kind, result, sources, exact)
                    yield Case(made.name, re.sub(r"const (f\d+ [abc])", r"const volatile \1", made.text))
    yield from _conversions()
    yield from _memory()
    for number, name in enumerate(MEETINGS):
        yield Case(name, f"t.meets = {number}; t.waits = &each; account.instructions += done; return;")
    for name in ("ret", "exit"):
        yield Case(name, "t.left = true; account.instructions += done; return;")
    yield Case("bra", "t.at = o[0];")
    yield Case("unpack.b32", "put<b16>(R[o[0]], R[o[2]]); put<b16>(R[o[1]], R[o[2]] >> 16);")
    yield Case("unpack.b64", "put<b32>(R[o[0]], R[o[2]]); put<b32>(R[o[1]], R[o[2]] >> 32);")
    for name in ("membar", "fence", "fence.sc"):
        yield Case(name, "")


def _plain(name: str, kind: str, result: str, sources: str, text: str) -> Case:
    types = {"T": kind, "W": WIDER.get(kind, kind), "p": "pred", "u": "u32", "h": "b16"}
    read = [(types[source], "abcd"[place], place + 1) for place, source in enumerate(sources)]
    taken = [f"const {of} {source} = get<{of}>(R[o[{place}]]);" for of, source, place in read]
    known = f"using T = {kind}; using W = {types['W']}; "
    return Case(name, known + " ".join(taken) + f" put<{types.get(result, result)}>(R[o[0]], {text});")


def _conversions() -> Iterator[Case]:
    for to in WHOLE.split():
        for of in WHOLE.split():
            yield _plain(f"cvt.{to}.{of}", of, to, "T", "a")
        for of in FLOATS.split():
            for mode, function in TO_WHOLE.items():
                yield _plain(f"cvt.{mode}.{to}.{of}", of, to, "T", f"whole<{to}>(std::{function}(a))")
            yield _plain(f"cvt.rn.{of}.{to}", to, of, "T", f"{of}(a)")
    yield _plain("cvt.f64.f32", "f32", "f64", "T", "a")
    yield _plain("cvt.rn.f32.f64", "f64", "f32", "T", "f32(a)")
    for kind in FLOATS.split():
        for mode, function in TO_WHOLE.items():
            yield _plain(f"cvt.{mode}.{kind}.{kind}", kind, kind, "T", f"std::{function}(a)")
        yield _plain(f"cvt.sat.{kind}.{kind}", kind, kind, "T", "a > 0 ? a < 1 ? a : 1 : 0")


def _memory() -> Iterator[Case]:
    for kind in f"{WHOLE} {FLOATS} b8 {BITS}".split():
        yield Case(f"ld.{kind}", f"load<{kind}>(t, o);")
        yield Case(f"st.{kind}", f"store<{kind}>(t, o);")
        if kind[1:] in ("32", "64"):
            for name, text in CHANGES.items():
                if kind[0] != "f" or name in ("add", "exch"):
                    change = f"[&]({kind} x, {kind} b, {kind} c) -> {kind} {{ return {text}; }}"
                    yield Case(f"atom.{name}.{kind}", f"change<{kind}>(t, o, {change});")
