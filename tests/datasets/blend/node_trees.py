"""Node trees with as much of Blender's interface as materials are read through, which can be evaluated."""

from typing import Any

KINDS = {
    "ShaderNodeVectorMath": "VECTOR",
    "ShaderNodeMath": "VALUE",
    "ShaderNodeRGB": "RGBA",
    "ShaderNodeValue": "VALUE",
}


class Socket:
    def __init__(self, node: "Node", name: str, value: Any = None, kind: str = "VALUE") -> None:
        self.node, self.name, self.identifier, self.default_value, self.type = node, name, name, value, kind
        self.links: list[Any] = []

    @property
    def is_linked(self) -> bool:
        return bool(self.links)


class Link:
    def __init__(self, source: Socket) -> None:
        self.from_socket, self.from_node = source, source.node


class Sockets(dict[str, Socket]):
    """By name, or by place."""

    def __getitem__(self, key: Any) -> Socket:
        return [*self.values()][key] if isinstance(key, int) else super().__getitem__(key)

    def __iter__(self) -> Any:
        return iter([*self.values()])

    def __contains__(self, key: object) -> bool:
        return key in self.keys()


class Node:
    mute = False

    def __init__(self, kind: str, inputs: dict[str, Any], outputs: dict[str, str]) -> None:
        self.bl_idname = kind
        self.inputs = Sockets({name: Socket(self, name, value) for name, value in inputs.items()})
        self.outputs = Sockets({name: Socket(self, name, kind=kind) for name, kind in outputs.items()})


ZERO = [0.0, 0.0, 0.0]
MADE: dict[str, tuple[dict[str, Any], dict[str, str]]] = {
    "ShaderNodeVectorMath": ({"Vector": [*ZERO], "Vector_001": [*ZERO], "Scale": 1.0}, {"Vector": "VECTOR"}),
    "ShaderNodeMath": ({"Value": 0.0, "Value_001": 0.0}, {"Value": "VALUE"}),
    "ShaderNodeMix": (
        {"Factor_Float": 0.0, "A_Float": 0.0, "B_Float": 0.0, "A_Vector": [*ZERO], "B_Vector": [*ZERO]},
        {"Result_Float": "VALUE", "Result_Vector": "VECTOR"},
    ),
    "ShaderNodeOutputAOV": ({"Color": [*ZERO, 1.0], "Value": 0.0}, {}),
}


class Tree:
    """``nodes.new`` and ``links.new``; ``written`` evaluates what was given to outputs (AOVs)."""

    def __init__(self) -> None:
        self.made: list[Node] = []
        self.nodes = self.links = self

    def new(self, *given: Any) -> Any:
        if len(given) == 2:
            source, target = given
            target.links = [Link(source)]
            return None
        inputs, outputs = MADE[given[0]]
        node = Node(given[0], {name: [*v] if isinstance(v, list) else v for name, v in inputs.items()}, outputs)
        self.made.append(node)
        return node

    def written(self) -> dict[str, Any]:
        found = {}
        for node in self.made:
            if node.bl_idname == "ShaderNodeOutputAOV":
                linked = next((each for each in node.inputs if each.is_linked), None)
                found[node.aov_name] = value_of(linked) if linked else None  # type: ignore[attr-defined]
        return found


def texture(value: Any) -> Socket:
    """An output whose value is not known beforehand."""
    node = Node("ShaderNodeTexImage", {"value": value}, {"out": "RGBA" if isinstance(value, tuple) else "VALUE"})
    return node.outputs["out"]


def value_of(socket: Any) -> Any:
    """The value of an input, an output or a constant."""
    if isinstance(socket, float | tuple):
        return socket
    if socket.name in [each.name for each in socket.node.inputs] and socket in [*socket.node.inputs]:
        if socket.is_linked:
            return value_of(socket.links[0].from_socket)
        return tuple(socket.default_value) if isinstance(socket.default_value, list) else socket.default_value
    node, given = socket.node, [value_of(each) for each in socket.node.inputs]
    if node.bl_idname == "ShaderNodeTexImage":
        return given[0]
    if node.bl_idname == "ShaderNodeMath":
        assert node.operation == "SUBTRACT"
        return given[0] - given[1]
    if node.bl_idname == "ShaderNodeVectorMath":
        if node.operation == "SCALE":
            return tuple(each * given[2] for each in given[0])
        assert node.operation == "ADD"
        return tuple(a + b for a, b in zip(given[0], given[1], strict=True))
    assert node.bl_idname == "ShaderNodeMix"
    share = given[0]
    if node.data_type == "FLOAT":
        return (1 - share) * given[1] + share * given[2]
    return tuple((1 - share) * a + share * b for a, b in zip(given[3], given[4], strict=True))


PRINCIPLED: dict[str, Any] = {
    "Base Color": [0.6, 0.4, 0.2, 1.0], "Metallic": 0.0, "Roughness": 0.3, "IOR": 1.5, "Alpha": 1.0, "Normal": None,
    "Diffuse Roughness": 0.0, "Subsurface Weight": 0.0, "Specular IOR Level": 0.5,
    "Specular Tint": [1.0, 1.0, 1.0, 1.0], "Anisotropic": 0.0, "Transmission Weight": 0.0, "Coat Weight": 0.0,
    "Sheen Weight": 0.0, "Emission Strength": 0.0,
}  # fmt: skip
SHADERS: dict[str, dict[str, Any]] = {
    "ShaderNodeBsdfPrincipled": PRINCIPLED,
    "ShaderNodeBsdfDiffuse": {"Color": [0.1, 0.2, 0.3, 1.0], "Roughness": 0.0, "Normal": None},
    "ShaderNodeBsdfAnisotropic": {"Color": [0.9, 0.9, 0.9, 1.0], "Roughness": 0.2, "Normal": None},
    "ShaderNodeBsdfTransparent": {"Color": [1.0, 1.0, 1.0, 1.0]},
    "ShaderNodeBsdfGlass": {"Color": [1.0, 1.0, 1.0, 1.0], "Normal": None},
    "ShaderNodeEmission": {"Color": [1.0, 1.0, 1.0, 1.0], "Strength": 1.0},
    "ShaderNodeMixShader": {"Fac": 0.5, "Shader": None, "Shader_001": None},
    "ShaderNodeAddShader": {"Shader": None, "Shader_001": None},
    "NodeReroute": {"Input": None},
    "ShaderNodeBsdfHair": {},
}


def shader(kind: str, **given: Any) -> Node:
    """A shader with some of its inputs given (``_`` for a space): values, or sockets that are linked to them."""
    node = Node(
        kind, {name: [*v] if isinstance(v, list) else v for name, v in SHADERS[kind].items()}, {"out": "SHADER"}
    )
    for name, value in given.items():
        target = node.inputs[name] if name in node.inputs else node.inputs[name.replace("_", " ")]
        if isinstance(value, Node | Socket):
            target.links = [Link(value.outputs["out"] if isinstance(value, Node) else value)]
        else:
            target.default_value = value
    return node


def leads_to(node: Node) -> Socket:
    """An input to which a shader is linked."""
    socket = Socket(Node("ShaderNodeOutputMaterial", {}, {}), "Surface", None, "SHADER")
    socket.links = [Link(node.outputs["out"])]
    return socket
