"""Arithmetic with shader sockets: nodes are added where a value is not known, and numbers stay numbers."""

from typing import Any

Scalar = Any
"""A number, or the output socket of one."""

Colour = Any
"""Three numbers, or the output socket of a colour or vector."""


class Arithmetic:
    """Expressions in one node tree."""

    def __init__(self, tree: Any) -> None:
        self.tree = tree

    def scalar(self, socket: Any) -> Scalar:
        """The value of an input socket: the socket that is linked to it, or its default value."""
        return socket.links[0].from_socket if socket.is_linked else float(socket.default_value)

    def colour(self, socket: Any) -> Colour:
        """The colour of an input socket: the socket that is linked to it, or its default colour."""
        return socket.links[0].from_socket if socket.is_linked else tuple(socket.default_value)[:3]

    def rest(self, value: Scalar) -> Scalar:
        """1 - value."""
        if isinstance(value, float):
            return 1.0 - value
        return self._node("ShaderNodeMath", {"operation": "SUBTRACT"}, {0: 1.0, 1: value}).outputs[0]

    def scaled(self, colour: Colour, by: Scalar) -> Colour:
        """Colour times number."""
        if isinstance(colour, tuple) and isinstance(by, float):
            return tuple(each * by for each in colour)
        if by == 1.0:
            return colour
        made = self._node("ShaderNodeVectorMath", {"operation": "SCALE"}, {"Vector": colour, "Scale": by})
        return made.outputs["Vector"]

    def mixed(self, share: Scalar, first: Scalar | Colour, second: Scalar | Colour) -> Scalar | Colour:
        """From first (share 0) to second (share 1): two numbers, or two colours."""
        known = (float, tuple)
        if isinstance(first, known) and isinstance(second, known) and first == second:
            return first
        kind = "VECTOR" if self._is_colour(first) or self._is_colour(second) else "FLOAT"
        made = self._node("ShaderNodeMix", {"data_type": kind, "clamp_factor": True}, {})
        inputs = {each.identifier: each for each in made.inputs}
        end = {"FLOAT": "Float", "VECTOR": "Vector"}[kind]
        for name, value in {"Factor_Float": share, f"A_{end}": first, f"B_{end}": second}.items():
            self._give(inputs[name], value)
        return next(each for each in made.outputs if each.identifier == f"Result_{end}")

    def added(self, first: Colour, second: Colour) -> Colour:
        """The sum of two colours."""
        if isinstance(first, tuple) and isinstance(second, tuple):
            return tuple(a + b for a, b in zip(first, second, strict=True))
        return self._node("ShaderNodeVectorMath", {"operation": "ADD"}, {0: first, 1: second}).outputs["Vector"]

    def write(self, name: str, value: Scalar | Colour) -> None:
        """Make a value an output of the renderer (an AOV), which ``declare`` has declared: albedo is a colour."""
        node = self.tree.nodes.new("ShaderNodeOutputAOV")
        node.aov_name = name
        self._give(node.inputs["Color" if name == "albedo" else "Value"], value)

    def _is_colour(self, value: Scalar | Colour) -> bool:
        return isinstance(value, tuple) or (not isinstance(value, float) and value.type in ("RGBA", "VECTOR"))

    def _node(self, kind: str, properties: dict[str, Any], inputs: dict[Any, Any]) -> Any:
        node = self.tree.nodes.new(kind)
        for name, value in properties.items():
            setattr(node, name, value)
        for name, value in inputs.items():
            self._give(node.inputs[name], value)
        return node

    def _give(self, socket: Any, value: Scalar | Colour) -> None:
        if isinstance(value, tuple):
            socket.default_value = (*value, 1.0)[: len(socket.default_value)]
        elif isinstance(value, float):
            socket.default_value = value
        else:
            self.tree.links.new(value, socket)
