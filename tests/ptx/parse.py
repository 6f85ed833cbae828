"""Reads PTX: a kernel's instructions with the places of their operands, for ``machine.cpp``.

Registers and constants are numbered slots of 64 bits. Functions are copied to where they are called, their parameters
being memory of the thread.
"""

import re
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from itertools import count
from typing import Any, NamedTuple

from ptx.operations import MEETINGS, cases, plain_name

OPERATIONS = {case.name: number for number, case in enumerate(cases())}
NAMES = {number: name for name, number in OPERATIONS.items()}
ACCESSES = ("ld", "st", "atom")
SEVERAL = ("unpack", "shfl", "match")
"""Operations with two results."""

SPACES = ("generic", "global", "local", "shared", "param", "const")
BASES = ("plain", "local", "param", "static", "%tid.x", "%ctaid.x", "%ntid.x", "%nctaid.x", "%laneid", "%warpid")
"""Bases of constants: a thread's memory, the kernel's parameters, constants in memory, a place."""

FIXED = {f"{name}.{axis}": int("n" in name) for name in ("%tid", "%ctaid", "%ntid", "%nctaid") for axis in "yz"}

_FUNCTION = re.compile(r"\.(entry|func)\s*(?:\(([^)]*)\))?\s*([\w$]+)\s*\(([^)]*)\)[^{;]*\{")
_VARIABLE = re.compile(r"\.(\w+)\s+(?:\.align\s+(\d+)\s+)?\.(\w+)\s+(?:\.ptr[^,]*?)?([\w$]+)\s*(?:\[(\d*)\])?")
_FREE = re.compile(r"(?:@\S+ )?(mul|add|sub)\.(f32|f64) ")
"""Operations without a rounding mode."""

_STATEMENT = re.compile(r"\s*(?:([\w$]+):|([{}])|([^;]+);)")
_OPERAND = re.compile(r"\[[^\]]*\]|\{[^}]*\}|\([^)]*\)|[^,\s][^,]*")
_CALL = re.compile(r"(?:\(([^)]*)\)\s*,\s*)?([\w$]+)\s*(?:,\s*\(([^)]*)\))?")


class UnknownPtx(Exception):
    """PTX that the machine does not execute."""


class Instruction(NamedTuple):
    """An instruction; see ``machine.cpp``."""

    operation: int
    guard: int
    negated: int
    operands: list[int]
    text: str


class Variable(NamedTuple):
    """A variable in memory, or a parameter: where it begins in its space, and its bytes."""

    begin: int
    size: int


class Program(NamedTuple):
    """A kernel."""

    code: list[Instruction]
    constants: dict[tuple[int, str], int]
    """Slots of values, each relative to one of BASES."""
    slots: int
    parameters: list[Variable]
    spaces: dict[str, int]
    """Bytes of local and shared memory."""
    static: bytes
    meets: bool


Scopes = tuple[str, ...]
"""Prefixes of the names that are known at a place, the innermost first; the last is that of the function."""


class _Statement(NamedTuple):
    text: str
    scopes: Scopes
    guard: str
    name: str
    operands: list[str]


class _Function(NamedTuple):
    results: str
    parameters: str
    body: str


def parsed(text: str) -> Program:
    """The kernel of a PTX text that has one. Raises UnknownPtx."""
    return _Reader(re.sub(r"//[^\n]*|\0", "", text)).program()


class _Reader:
    def __init__(self, text: str) -> None:
        self.text = text
        self.functions: dict[str, _Function] = {}
        self.constants: dict[tuple[int, str], int] = {}
        self.numbers, self.copies = count(1), count()
        self.registers: dict[str, int] = {}
        self.declared: set[str] = set()
        """Names of registers, or what is before the numbers of many."""
        self.memory: dict[str, tuple[str, int]] = {}
        self.spaces = {"local": 0, "shared": 0, "param": 0}
        self.static = bytearray()
        self.code: list[_Statement] = []
        self.labels: dict[str, int] = {}
        self.meets = False
        entries = []
        for found in _FUNCTION.finditer(text):
            self.functions[found[3]] = _Function(found[2] or "", found[4], _braced(text, found.end()))
            entries += [found[3]] if found[1] == "entry" else []
        (self.entry,) = entries

    def program(self) -> Program:
        entry = self.functions[self.entry]
        parameters = [self._lay_out("param", "", each) for each in _VARIABLE.finditer(entry.parameters)]
        self._expand(entry.body, "", {})
        code = contracted([self._encoded(each) for each in self.code], set(self.labels.values()))
        slots = next(self.numbers)
        return Program(code, self.constants, slots, parameters, self.spaces, bytes(self.static), self.meets)

    def _lay_out(self, space: str, prefix: str, found: re.Match[str]) -> Variable:
        width = 1 if found[3] == "pred" else int(found[3][1:]) // 8
        size, align = width * int(found[5] or 1), int(found[2] or width)
        begin = -(-self.spaces[space] // align) * align
        self.spaces[space] = begin + size
        self.memory[prefix + found[4]] = space, begin
        return Variable(begin, size)

    # ---- from statements to instructions
    def _expand(self, body: str, function: str, bound: dict[str, tuple[str, int]]) -> None:
        """Add the instructions of a function; ``bound``: places of its parameters' memory.

        Names are known in the scope of their braces, which a prefix stands for.
        """
        scopes = [function]
        self.memory |= {function + name: place for name, place in bound.items()}
        for label, brace, statement in _STATEMENT.findall(body):
            if brace == "{":
                scopes.insert(0, f"{function}{next(self.copies)}.")
            elif brace == "}":
                scopes.pop(0)
            elif label:
                self.labels[function + label] = len(self.code)
            elif statement.lstrip().startswith("."):
                self._declare(statement, scopes[0])
            else:
                self._add(" ".join(statement.split()), tuple(scopes))
        self.labels[f"{function}end"] = len(self.code)

    def _declare(self, statement: str, scope: str) -> None:
        kind = statement.split()[0]
        if kind in (".local", ".shared", ".param") and (found := _VARIABLE.search(statement)):
            self._lay_out("shared" if kind == ".shared" else "local", scope, found)
        elif kind == ".reg":
            names = re.findall(r"([\w%]+)(<\d+>)?\s*(?:,|$)", statement)
            self.declared |= {scope + name + ("<>" if many else "") for name, many in names}
        elif kind != ".pragma":
            raise UnknownPtx(statement)

    def _add(self, text: str, scopes: Scopes) -> None:
        guard, _, rest = text.partition(" ") if text.startswith("@") else ("", "", text)
        opcode, _, listed = rest.partition(" ")
        name, operands = plain_name(opcode), [each.strip() for each in _OPERAND.findall(listed)]
        if name == "call" and not guard:
            self._inline(listed, scopes)
        elif name == "bra" or (name == "ret" and scopes[-1]):
            self._put(text, scopes, guard, "bra", [scopes[-1] + (operands[0] if operands else "end")])
        elif (joined := re.fullmatch(r"(setp\.\w+)\.(and|or|xor)\.(.+)", name)) and not guard:
            result, *compared, other = operands
            self._put(text, scopes, "", f"{joined[1]}.{joined[3]}", ["_", *compared])
            self._put(text, scopes, "", f"{joined[2]}.pred", [result, "_", other])
        elif name.startswith("red."):
            self._put(text, scopes, guard, f"atom{name[3:]}", ["_", *operands])
        else:
            self._put(text, scopes, guard, name, operands)

    def _put(self, *statement: Any) -> None:
        self.code.append(_Statement(*statement))

    def _inline(self, listed: str, scopes: Scopes) -> None:
        found = _CALL.match(listed)
        if found is None or found[2] not in self.functions:
            raise UnknownPtx(f"call {listed}")
        called = self.functions[found[2]]
        given = [name.strip() for part in (found[1], found[3]) for name in (part or "").split(",") if name.strip()]
        own = [each[4] for part in (called.results, called.parameters) for each in _VARIABLE.finditer(part)]
        places = [self._in_memory(name, scopes) for name in given]
        self._expand(called.body, f"{scopes[-1]}{next(self.copies)}:", dict(zip(own, places, strict=True)))

    # ---- operands
    def _encoded(self, given: _Statement) -> Instruction:
        text, scopes, guard, name, operands = given
        held = [0] * 8
        kind = name.partition(".")[0]
        if kind in ACCESSES:
            name = self._access(name, operands, scopes, held)
        elif name in MEETINGS:
            self._meeting(name, operands, scopes, held)
        elif name == "bra":
            held[0] = self.labels[operands[0]]
        else:
            if kind == "mov" and any("{" in each for each in operands):
                name = f"{'un' if '{' in operands[0] else ''}pack.{name[4:]}"
            for place, operand in enumerate(part for each in operands for part in each.strip("{}").split(",")):
                held[place] = self._slot(operand.strip(), scopes)
        if name not in OPERATIONS:
            raise UnknownPtx(text)
        at = self._slot(guard.lstrip("@!"), scopes) if guard else -1
        return Instruction(OPERATIONS[name], at, int(guard.startswith("@!")), held, text)

    def _access(self, name: str, operands: Sequence[str], scopes: Scopes, held: list[int]) -> str:
        """Places of a load, a store or an atomic change; its name without the space and the number of its values."""
        kind, *middle, of = name.split(".")
        space = next((part for part in middle if part in SPACES), "generic")
        middle = [part for part in middle if part != space and part not in ("v2", "v4")]
        memory = next(each for each in operands if each.startswith("["))
        values = [part.strip() for each in operands if each is not memory for part in each.strip("{}").split(",")]
        base, sign, offset = re.fullmatch(r"\[\s*([^+\-\s]+)\s*([+-]*)\s*(\w*)\s*\]", memory).groups()
        for place, value in enumerate(values):
            held[place] = self._slot(value, scopes)
        held[4], held[5] = self._slot(base, scopes), int(sign.replace("+", "") + (offset or "0"), 0)
        of_call = space == "param" and not base.startswith("%") and self._in_memory(base, scopes)[0] == "local"
        held[6], held[7] = len(values), SPACES.index("local" if of_call else space)
        return ".".join([kind, *middle, of])

    def _meeting(self, name: str, operands: Sequence[str], scopes: Scopes, held: list[int]) -> None:
        """Places of results, values and, last, the mask of lanes."""
        self.meets = True
        if name == "bar.sync":
            if operands != ["0"]:
                raise UnknownPtx(f"{name} {operands}")
            return
        *others, mask = operands
        first, _, second = others[0].partition("|") if others else ("_", "", "")
        for place, operand in enumerate([first, second or "_", *others[1:]]):
            held[place] = self._slot(operand, scopes)
        held[7] = self._slot(mask, scopes)

    def _slot(self, operand: str, scopes: Scopes) -> int:
        """The slot of a register, or of the constant that a number, a name in memory or a place of the thread is."""
        if operand in BASES:
            return self._constant(0, operand)
        if operand in FIXED:
            return self._constant(FIXED[operand], "plain")
        if operand == "_" or operand.startswith("%"):
            return self._register(operand, scopes)
        if re.fullmatch(r"0[fFdD][0-9A-Fa-f]+", operand):
            return self._constant(int(operand[2:], 16), "plain")
        if re.fullmatch(r"-?(0x[0-9A-Fa-f]+|\d+)U?", operand):
            return self._constant(int(operand.rstrip("U"), 0) & 2**64 - 1, "plain")
        space, begin = self._in_memory(operand, scopes)
        return self._constant(begin, "plain" if space == "shared" else space)

    def _register(self, name: str, scopes: Scopes) -> int:
        many = name.rstrip("0123456789") + "<>"
        scope = next((each for each in scopes if {each + name, each + many} & self.declared), None)
        if scope is None and name != "_":
            raise UnknownPtx(f"register {name}")
        return _first(self.registers, f"{scope}{name}", self.numbers)

    def _constant(self, value: int, base: str) -> int:
        return _first(self.constants, (value, base), self.numbers)

    def _in_memory(self, name: str, scopes: Scopes) -> tuple[str, int]:
        """The space of a variable, and where it begins there."""
        known = next((scope + name for scope in (*scopes, "") if scope + name in self.memory), None)
        return self._static(name) if known is None else self.memory[known]

    def _static(self, name: str) -> tuple[str, int]:
        """Put a constant of the PTX text into memory."""
        found = re.search(
            rf"\.(?:const|global) [^;=]*?\.(\w+) {re.escape(name)}(?:\[\d*\])?\s*=\s*\{{?([^;}}]*)", self.text
        )
        if found is None:
            raise UnknownPtx(f"name {name}")
        width = int(found[1][1:]) // 8
        self.static += bytes(-len(self.static) % 16)
        begin = len(self.static)
        for value in found[2].split(","):
            number = re.sub(r"^\s*0[fFdD]", "0x", value)
            self.static += (int(number, 0) & 256**width - 1).to_bytes(width, "little")
        self.memory[name] = "static", begin
        return self.memory[name]


def contracted(code: Sequence[Instruction], starts: Collection[int]) -> list[Instruction]:
    """The code with products and sums in one step, where they have no rounding mode and ptxas may do so.

    Which of them ptxas fuses is unknown: here, each product used by exactly one sum, in its own block. ``starts``:
    where blocks start.
    """
    uses = Counter(slot for each in code for slot in _slots(each))
    made, products = list(code), dict[int, int]()
    for at, each in enumerate(code):
        free = _FREE.match(each.text)
        if at in starts or NAMES[each.operation] == "bra":
            products.clear()
        if free and free[1] != "mul" and (taken := next((k for k in (1, 2) if each.operands[k] in products), 0)):
            product = products[each.operands[taken]]
            name = "fma" if free[1] == "add" else ("fms", "fnma")[taken - 1]
            operands = [each.operands[0], *code[product].operands[1:3], each.operands[3 - taken], *each.operands[4:]]
            made[at] = each._replace(operation=OPERATIONS[f"{name}.{free[2]}"], operands=operands)
            made[product] = code[product]._replace(operation=OPERATIONS["membar"])
        written = set(_written(each))
        products = {slot: own for slot, own in products.items() if not written & {slot, *code[own].operands[1:3]}}
        if free and free[1] == "mul" and uses[each.operands[0]] == 2 and each.guard < 0:
            products[each.operands[0]] = at
    return made


def _slots(each: Instruction) -> list[int]:
    """The slots that an instruction reads or writes."""
    kind = NAMES[each.operation].partition(".")[0]
    if kind == "bra":
        return []
    held = [*each.operands[: each.operands[6]], each.operands[4]] if kind in ACCESSES else each.operands
    return [slot for slot in (*held, each.guard) if slot > 0]


def _written(each: Instruction) -> list[int]:
    kind = NAMES[each.operation].partition(".")[0]
    return each.operands[: {"st": 0, "ld": each.operands[6]}.get(kind, 2 if kind in SEVERAL else 1)]


def _braced(text: str, begin: int) -> str:
    """The text from behind an opening brace to the one that closes it."""
    depth = 1
    for found in re.finditer("[{}]", text[begin:]):
        depth += 1 if found[0] == "{" else -1
        if depth == 0:
            return text[begin : begin + found.start()]
    raise UnknownPtx("braces without an end")


def _first(known: dict[Any, int], key: Any, numbers: Iterator[int]) -> int:
    """The number of a key, which is the next one for a new key."""
    if key not in known:
        known[key] = next(numbers)
    return known[key]
