"""The .blend files of the set ``others``: scans and models by other people, with materials made of Blender's own nodes.

    python blend_files.py MESHES OUT [SCENE ...]

Runs in a Python that has ``bpy``. MESHES is a folder of odedstein/meshes (commit 8352132), or the .obj files alone; OUT
gets one file a scene. The world has Z up and is measured in units; each scene lies within +-1.5 units, where published
cameras look. Materials are Principled BSDFs whose inputs vary continuously: noise, gradients, veins, dirt in cavities.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from math import cos, pi, radians, sin
from pathlib import Path
from typing import Any

import bpy
from mathutils import Matrix, Vector

Socket = Any
Value = Any
"""The output socket of a node, a number, or a linear RGB colour."""

Triple = tuple[float, float, float]
"""Coordinates, degrees about the axes, or a linear RGB colour."""

Y_UP = Matrix.Rotation(radians(90), 4, "X")
LYING = Matrix.Rotation(radians(90), 4, "Z")


class Nodes:
    """The node tree of one material, in which values are computed from places on the surface (object coordinates)."""

    def __init__(self, name: str) -> None:
        self.material = bpy.data.materials.new(name)
        if self.material.node_tree is None:  # before Blender 5.0
            self.material.use_nodes = True
        self.tree = self.material.node_tree
        self.tree.nodes.clear()
        self.place = self._add("ShaderNodeTexCoord").outputs["Object"]

    def _add(self, kind: str, inputs: dict[Any, Value] | None = None, **properties: Any) -> Any:
        node = self.tree.nodes.new(kind)
        for name, value in properties.items():
            setattr(node, name, value)
        for name, value in (inputs or {}).items():
            self.give(node.inputs[name], value)
        return node

    def give(self, socket: Socket, value: Value) -> None:
        """Link a socket to an input, or set the input's value."""
        if isinstance(value, bpy.types.NodeSocket):
            self.tree.links.new(value, socket)
        elif isinstance(value, tuple) and len(socket.default_value) == 4:
            socket.default_value = (*value, 1.0)
        else:
            socket.default_value = value

    def noise(self, scale: float, detail: float = 4.0, distortion: float = 0.0, seed: float = 0.0) -> Socket:
        """Fractal noise about 0.5."""
        given = {"Vector": self.place, "W": seed, "Scale": scale, "Detail": detail, "Distortion": distortion}
        return self._add("ShaderNodeTexNoise", given, noise_dimensions="4D").outputs[0]

    def cells(self, scale: float) -> Socket:
        """Distance to the nearest of scattered points, smooth: blotches."""
        given = {"Vector": self.place, "Scale": scale, "Smoothness": 0.6}
        return self._add("ShaderNodeTexVoronoi", given, feature="SMOOTH_F1").outputs["Distance"]

    def veins(self, scale: float, distortion: float, rings: bool = False) -> Socket:
        """Bands that noise bends: wood and marble."""
        given = {"Vector": self.place, "Scale": scale, "Distortion": distortion, "Detail": 3.0, "Detail Scale": 1.2}
        return self._add("ShaderNodeTexWave", given, wave_type="RINGS" if rings else "BANDS").outputs["Fac"]

    def along(self, axis: int, low: float, high: float) -> Socket:
        """0 at ``low`` and 1 at ``high`` of an object coordinate."""
        place = self._add("ShaderNodeSeparateXYZ", {0: self.place}).outputs[axis]
        given = {"Value": place, "From Min": low, "From Max": high}
        return self._add("ShaderNodeMapRange", given, clamp=True).outputs["Result"]

    def cavities(self, low: float = 0.46, high: float = 0.51) -> Socket:
        """0 in cavities of the mesh, 1 on its ridges (Cycles' pointiness)."""
        pointed = self._add("ShaderNodeNewGeometry").outputs["Pointiness"]
        given = {"Value": pointed, "From Min": low, "From Max": high}
        return self._add("ShaderNodeMapRange", given, clamp=True, interpolation_type="SMOOTHSTEP").outputs["Result"]

    def ramp(self, share: Socket, *stops: tuple[float, Triple]) -> Socket:
        """Colours at given shares, and linearly between them."""
        node = self._add("ShaderNodeValToRGB", {"Fac": share})
        elements = node.color_ramp.elements
        while len(elements) < len(stops):
            elements.new(0.5)
        for element, (at, colour) in zip(elements, stops, strict=True):
            element.position, element.color = at, (*colour, 1.0)
        return node.outputs["Color"]

    def between(self, share: Value, first: Value, second: Value) -> Socket:
        """The mixture of two colours: ``first`` at share 0."""
        node = self._add("ShaderNodeMix", data_type="RGBA", clamp_factor=True)
        inputs = {each.identifier: each for each in node.inputs}
        for name, value in {"Factor_Float": share, "A_Color": first, "B_Color": second}.items():
            self.give(inputs[name], value)
        return next(each for each in node.outputs if each.identifier == "Result_Color")

    def ranged(self, share: Socket, low: float, high: float, begin: float = 0.0, end: float = 1.0) -> Socket:
        """A number from ``low`` (share ``begin``) to ``high`` (share ``end``), smooth at both ends."""
        given = {"Value": share, "From Min": begin, "From Max": end, "To Min": low, "To Max": high}
        return self._add("ShaderNodeMapRange", given, clamp=True, interpolation_type="SMOOTHSTEP").outputs["Result"]

    def principled(self, base: Value, roughness: Value, metallic: Value = 0.0, coat: float = 0.0) -> Any:
        """The material: a Principled BSDF with F0 = 0.04."""
        given = {"Base Color": base, "Roughness": roughness, "Metallic": metallic, "Coat Weight": coat,
                 "Coat Roughness": 0.08, "IOR": 1.5, "Specular IOR Level": 0.5}  # fmt: skip
        shader = self._add("ShaderNodeBsdfPrincipled", given)
        output = self._add("ShaderNodeOutputMaterial")
        self.tree.links.new(shader.outputs[0], output.inputs["Surface"])
        return self.material


class Stage:
    """An empty file, objects for it, and where their meshes are."""

    def __init__(self, meshes: Path) -> None:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self._meshes = meshes

    def scan(
        self,
        file: str,
        material: Any,
        size: float,
        at: Triple = (0, 0, 0),
        turned: Triple = (0, 0, 0),
        up: Matrix = Y_UP,
        refined: int = 0,
    ) -> Any:
        """A mesh by its file's name, ``size`` units along its longest side, standing on ``at``, its middle above it.

        turned: degrees about X, Y and Z, after it was set upright. refined: levels of subdivision.
        """
        path = next(iter(sorted(self._meshes.rglob(f"{file}.obj"))), None)
        if path is None:
            sys.exit(f"{self._meshes} has no {file}.obj: give a folder of odedstein/meshes, commit 8352132")
        known = {*bpy.data.objects}
        bpy.ops.wm.obj_import(filepath=str(path), forward_axis="Y", up_axis="Z")
        (thing,) = {*bpy.data.objects} - known
        rotation = Matrix.Identity(4)
        for axis, angle in zip("XYZ", turned, strict=True):
            rotation = Matrix.Rotation(radians(angle), 4, axis) @ rotation
        mesh = thing.data
        mesh.transform(rotation @ up)
        low, high = box(mesh)
        mesh.transform(Matrix.Translation(-(low + high) / 2))
        mesh.transform(Matrix.Scale(size / max(high - low), 4))
        low, high = box(mesh)
        mesh.transform(Matrix.Translation((0, 0, -low.z)))
        thing.matrix_world = Matrix.Translation(at)
        return self._finished(thing, material, refined, smooth=True)

    def block(self, material: Any, size: Triple, at: Triple, bevel: float = 0.02) -> Any:
        """A box with rounded edges, by its sides and its middle."""
        bpy.ops.mesh.primitive_cube_add(size=1)
        thing = bpy.context.object
        thing.data.transform(Matrix.Diagonal((*size, 1)))
        thing.matrix_world = Matrix.Translation(at)
        edges = thing.modifiers.new("edges", "BEVEL")
        edges.width, edges.segments = bevel, 3
        return self._finished(thing, material)

    def drum(self, material: Any, radius: float, height: float, at: Triple) -> Any:
        """A cylinder with rounded edges, by its middle."""
        bpy.ops.mesh.primitive_cylinder_add(radius=radius, depth=height, vertices=128)
        thing = bpy.context.object
        thing.matrix_world = Matrix.Translation(at)
        edges = thing.modifiers.new("edges", "BEVEL")
        edges.width, edges.segments, edges.limit_method = 0.02, 3, "ANGLE"
        return self._finished(thing, material)

    def basin(self, material: Any, radius: float, thick: float, at: Triple) -> Any:
        """The part of a hollow ball below 20 degrees of latitude, by the middle of the ball."""
        rings, around = 64, 128
        heights = [radians(-89.9 + 110 * ring / (rings - 1)) for ring in range(rings)]
        turns = [2 * pi * step / around for step in range(around)]
        places = [(radius * cos(up) * cos(turn), radius * cos(up) * sin(turn), radius * sin(up))
                  for up in heights for turn in turns]  # fmt: skip
        corners = [(0, 0), (0, 1), (1, 1), (1, 0)]
        faces = [[(ring + up) * around + (step + beside) % around for up, beside in corners]
                 for ring in range(rings - 1) for step in range(around)]  # fmt: skip
        mesh = bpy.data.meshes.new("basin")
        mesh.from_pydata([*places], [], [*faces, list(range(around))[::-1]])
        thing = bpy.data.objects.new("basin", mesh)
        bpy.context.scene.collection.objects.link(thing)
        thing.matrix_world = Matrix.Translation(at)
        walls = thing.modifiers.new("walls", "SOLIDIFY")
        walls.thickness, walls.offset = thick, -1
        return self._finished(thing, material, smooth=True)

    def _finished(self, thing: Any, material: Any, refined: int = 0, smooth: bool = False) -> Any:
        thing.data.materials.clear()
        thing.data.materials.append(material)
        if refined:
            thing.modifiers.new("refined", "SUBSURF").render_levels = refined
        if smooth:
            thing.data.shade_smooth()
        return thing


def box(mesh: Any) -> tuple[Vector, Vector]:
    """Lowest and highest coordinates of a mesh."""
    axes = list(zip(*(each.co for each in mesh.vertices), strict=True))
    return Vector(map(min, axes)), Vector(map(max, axes))


def shade(colour: Triple, factor: float) -> Triple:
    """A darker colour."""
    return (factor * colour[0], factor * colour[1], factor * colour[2])


def cow_hide() -> Any:
    """Cream and brown blotches, and mud up to the knees."""
    nodes = Nodes("hide")
    brown, cream, dull = (0.20, 0.09, 0.04), (0.82, 0.74, 0.6), (0.7, 0.58, 0.42)
    fur = nodes.ramp(nodes.noise(1.6, 2.0, 0.4), (0.44, brown), (0.5, cream), (1.0, dull))
    mud = nodes.between(nodes.noise(9.0), (0.10, 0.07, 0.04), (0.22, 0.17, 0.11))
    base = nodes.between(nodes.along(2, 0.08, 0.55), mud, fur)
    return nodes.principled(base, nodes.ranged(nodes.noise(5.0, seed=3.0), 0.4, 0.85, 0.3, 0.7))


def turf() -> Any:
    """Grass and bare earth."""
    nodes = Nodes("turf")
    grass = nodes.between(nodes.noise(14.0), (0.06, 0.14, 0.02), (0.22, 0.32, 0.09))
    base = nodes.between(nodes.ranged(nodes.noise(2.2, seed=8.0), 0.0, 1.0, 0.45, 0.62), grass, (0.29, 0.19, 0.12))
    return nodes.principled(base, 0.9)


def wood(dark: Triple, light: Triple, scale: float, rough: float) -> Any:
    """Planks' grain, worn in places."""
    nodes = Nodes("wood")
    grain = nodes.between(nodes.veins(scale, 6.0), dark, light)
    base = nodes.between(nodes.ranged(nodes.noise(2.0), 0.0, 0.5, 0.45, 0.75), grain, shade(dark, 0.5))
    return nodes.principled(base, nodes.ranged(nodes.noise(3.0, seed=2.0), rough - 0.15, rough + 0.2, 0.3, 0.7))


def plaster(white: Triple, stain: Triple) -> Any:
    """A painted wall with damp stains that begin below."""
    nodes = Nodes("plaster")
    damp = nodes.between(nodes.along(2, -0.4, 0.6), nodes.noise(1.8, 6.0), (0.0, 0.0, 0.0))
    base = nodes.between(nodes.ranged(damp, 0.0, 0.9, 0.3, 0.75), white, stain)
    return nodes.principled(base, nodes.ranged(nodes.noise(4.0), 0.65, 0.9, 0.3, 0.7))


def leather(dark: Triple, light: Triple, rough: float, coat: float = 0.0) -> Any:
    """Leather, lighter on ridges and dusty at the sole."""
    nodes = Nodes("leather")
    worn = nodes.between(nodes.cavities(), dark, light)
    blotched = nodes.between(nodes.ranged(nodes.noise(4.0, 6.0), 0.0, 0.55, 0.4, 0.7), worn, shade(dark, 0.45))
    base = nodes.between(nodes.along(2, 0.02, 0.35), (0.34, 0.29, 0.22), blotched)
    return nodes.principled(base, nodes.ranged(nodes.noise(6.0), rough, rough + 0.25, 0.3, 0.7), coat=coat)


def enamel(first: Triple, second: Triple, scale: float, rough: float = 0.15) -> Any:
    """A glaze that runs from one colour to another, with blotches and a varying gloss."""
    nodes = Nodes("enamel")
    run = nodes.between(nodes.along(2, 0.05, 0.75), first, second)
    spots = nodes.ranged(nodes.cells(scale), 0.7, 0.0, 0.15, 0.45)
    base = nodes.between(spots, run, (0.86, 0.83, 0.78))
    return nodes.principled(base, nodes.ranged(nodes.noise(3.0), rough, rough + 0.35, 0.35, 0.65))


def sand() -> Any:
    """Pale sand with darker ripples."""
    nodes = Nodes("sand")
    base = nodes.between(nodes.veins(5.0, 9.0), (0.5, 0.4, 0.27), (0.36, 0.27, 0.17))
    return nodes.principled(nodes.between(nodes.noise(20.0), base, (0.5, 0.43, 0.32)), 0.85)


def painted_limestone() -> Any:
    """Paint that runs over a bust from shoulder to crown; limestone where it is worn, dust in cavities."""
    nodes = Nodes("painted limestone")
    paint = nodes.ramp(nodes.along(2, 0.1, 2.1), (0.0, (0.63, 0.55, 0.42)), (0.22, (0.45, 0.2, 0.1)),
                       (0.42, (0.58, 0.33, 0.2)), (0.62, (0.52, 0.27, 0.16)), (0.72, (0.07, 0.12, 0.24)),
                       (1.0, (0.1, 0.2, 0.33)))  # fmt: skip
    worn = nodes.between(nodes.ranged(nodes.noise(3.5, 8.0), 0.0, 1.0, 0.5, 0.68), paint, (0.68, 0.62, 0.52))
    base = nodes.between(nodes.cavities(0.485, 0.503), (0.16, 0.12, 0.09), worn)
    return nodes.principled(base, nodes.ranged(nodes.noise(2.4, seed=5.0), 0.35, 0.8, 0.35, 0.65))


def marble(white: Triple, vein: Triple, rough: float, scale: float = 1.6) -> Any:
    """Polished stone with bent veins and soft clouds, dirt in cavities."""
    nodes = Nodes("marble")
    clouds = nodes.between(nodes.noise(1.4), white, shade(white, 0.86))
    veined = nodes.between(nodes.ranged(nodes.veins(scale, 12.0), 0.0, 0.85, 0.6, 1.0), clouds, vein)
    base = nodes.between(nodes.cavities(0.44, 0.495), shade(white, 0.35), veined)
    return nodes.principled(base, nodes.ranged(nodes.noise(2.0, seed=1.0), rough, rough + 0.3, 0.35, 0.65))


def terracotta() -> Any:
    """Fired clay with soot and lime."""
    nodes = Nodes("terracotta")
    clay = nodes.between(nodes.noise(3.0, 6.0), (0.44, 0.18, 0.09), (0.6, 0.31, 0.18))
    lime = nodes.between(nodes.ranged(nodes.noise(5.0, 8.0, seed=4.0), 0.0, 0.8, 0.55, 0.75), clay, (0.66, 0.6, 0.52))
    return nodes.principled(nodes.between(nodes.cavities(0.485, 0.503), (0.09, 0.06, 0.05), lime), 0.75)


def horn_and_bone() -> Any:
    """A skull's bone that grows into dark horn."""
    nodes = Nodes("bone")
    bone = nodes.between(nodes.noise(4.0, 6.0), (0.72, 0.64, 0.48), (0.5, 0.4, 0.26))
    horn = nodes.between(nodes.veins(7.0, 2.0), (0.1, 0.07, 0.05), (0.24, 0.17, 0.11))
    base = nodes.between(nodes.ranged(nodes.along(2, 0.0, 1.6), 0.0, 1.0, 0.5, 0.75), bone, horn)
    base = nodes.between(nodes.cavities(0.45, 0.5), (0.2, 0.14, 0.09), base)
    return nodes.principled(base, nodes.ranged(nodes.along(2, 0.0, 1.6), 0.7, 0.35, 0.5, 0.75))


def steel_and_ash() -> Any:
    """A hammer: its head is steel with rust, its handle ash wood."""
    nodes = Nodes("steel and ash")
    head = nodes.ranged(nodes.along(0, -1.3, 1.3), 0.0, 1.0, 0.70, 0.74)
    rust = nodes.ranged(nodes.noise(5.0, 8.0), 0.0, 1.0, 0.52, 0.66)
    iron = nodes.between(rust, (0.56, 0.55, 0.53), (0.22, 0.09, 0.04))
    ash = nodes.between(nodes.veins(5.0, 3.0), (0.42, 0.27, 0.14), (0.62, 0.46, 0.28))
    bare = nodes.between(rust, (1.0, 1.0, 1.0), (0.0, 0.0, 0.0))
    metallic = nodes.between(head, (0.0, 0.0, 0.0), bare)
    rough = nodes.between(head, (0.5, 0.5, 0.5), nodes.between(rust, (0.25, 0.25, 0.25), (0.85, 0.85, 0.85)))
    return nodes.principled(nodes.between(head, ash, iron), rough, metallic)


def spot(stage: Stage) -> None:
    """A cow on a meadow, under a sun behind trees."""
    stage.scan("spot_low_resolution", cow_hide(), 1.9, (0, 0, -0.75), (0, 0, 35), refined=2)
    stage.drum(turf(), 1.35, 0.2, (0, 0, -0.85))


def workbench(stage: Stage) -> None:
    """A boot and a hammer on a table, before a wall: seen from the front."""
    stage.scan("boot", leather((0.12, 0.07, 0.04), (0.45, 0.3, 0.17), 0.35), 1.15, (0.15, -0.55, -0.6), (0, 0, 65))
    stage.scan("hammer", enamel((0.5, 0.06, 0.04), (0.5, 0.06, 0.04), 2.0), 1.3, (0.3, 0.35, -0.6), (0, 90, 60), LYING)
    stage.block(wood((0.2, 0.1, 0.05), (0.42, 0.25, 0.13), 1.6, 0.45), (1.6, 2.5, 0.12), (0.1, 0, -0.66))
    stage.block(plaster((0.9, 0.89, 0.86), (0.5, 0.42, 0.3)), (0.12, 2.5, 1.9), (-0.76, 0, 0.23))


def shoal(stage: Stage) -> None:
    """Three glazed fish above a plate of sand: each shades the next."""
    stage.scan("fish", enamel((0.75, 0.3, 0.08), (0.25, 0.05, 0.04), 5.0), 1.5, (-0.35, -0.5, -0.1), (0, 12, 20))
    stage.scan("fish", enamel((0.06, 0.25, 0.4), (0.1, 0.5, 0.45), 7.0), 1.25, (0.35, 0.45, -0.35), (0, -10, 140))
    stage.scan("fish", enamel((0.55, 0.5, 0.1), (0.2, 0.32, 0.08), 6.0), 0.95, (0.3, -0.25, 0.55), (8, -20, 265))
    stage.block(sand(), (2.3, 2.3, 0.18), (0, 0, -0.85), 0.06)


def boot(stage: Stage) -> None:
    """A polished boot on a drum of wood: a clear coat lies on its leather."""
    stage.scan("boot", leather((0.16, 0.05, 0.03), (0.36, 0.14, 0.08), 0.45, coat=1.0), 1.9, (0, 0, -0.65), (0, 0, 25))
    stage.drum(wood((0.28, 0.17, 0.09), (0.5, 0.35, 0.2), 2.0, 0.55), 1.2, 0.2, (0, 0, -0.75))


def nefertiti(stage: Stage) -> None:
    """A painted bust on a plinth of stone, under a cloudy sky."""
    stage.scan("nefertiti-lowres", painted_limestone(), 2.1, (0, 0, -0.85), (0, 0, 20))
    stage.drum(marble((0.5, 0.48, 0.45), (0.2, 0.18, 0.17), 0.3), 0.75, 0.35, (0, 0, -1.03))


def orators(stage: Stage) -> None:
    """Two busts on a slab, before a low sun in haze: one stands in the other's shadow."""
    stone = marble((0.75, 0.73, 0.68), (0.4, 0.36, 0.33), 0.3)
    stage.scan("demosthenes-low-res", stone, 1.5, (-0.45, -0.55, -0.75), (0, 0, 75), refined=1)
    stage.scan("nefertiti-lowres", terracotta(), 1.6, (0.4, 0.55, -0.75), (0, 0, -70))
    stage.block(marble((0.58, 0.55, 0.5), (0.3, 0.25, 0.2), 0.5), (2.0, 2.5, 0.2), (0, 0, -0.85))


def trophy(stage: Stage) -> None:
    """A goat's head on a shield of wood, on an off-white wall: seen from the front."""
    stage.scan("goathead", horn_and_bone(), 1.6, (0.2, 0, -0.75), (0, 0, 90), refined=1)
    stage.block(wood((0.13, 0.07, 0.03), (0.3, 0.17, 0.09), 2.4, 0.35), (0.14, 1.1, 1.5), (-0.62, 0, 0))
    stage.block(plaster((0.62, 0.6, 0.55), (0.4, 0.36, 0.3)), (0.12, 2.5, 2.3), (-0.75, 0, 0))


def still_life(stage: Stage) -> None:
    """A boot, a fish and a cow on a table with a wall behind them."""
    stage.scan("boot", leather((0.3, 0.22, 0.14), (0.55, 0.45, 0.33), 0.5), 1.0, (-0.1, -0.75, -0.6), (0, 0, 80))
    stage.scan("fish", enamel((0.08, 0.22, 0.38), (0.45, 0.52, 0.55), 4.0), 1.0, (0.25, 0.1, -0.6), (90, 0, 70))
    stone = marble((0.8, 0.77, 0.72), (0.35, 0.33, 0.36), 0.2)
    stage.scan("spot_low_resolution", stone, 1.05, (-0.15, 0.8, -0.6), (0, 0, 115), refined=2)
    stage.block(wood((0.3, 0.19, 0.1), (0.55, 0.38, 0.22), 1.2, 0.5), (1.5, 2.6, 0.12), (0, 0, -0.66))
    stage.block(plaster((0.72, 0.66, 0.52), (0.42, 0.33, 0.24)), (0.12, 2.6, 1.7), (-0.75, 0, 0.13))


def grotto(stage: Stage) -> None:
    """A fish in a deep basin of veined marble: much of its light comes from the basin."""
    stage.basin(marble((0.75, 0.73, 0.69), (0.45, 0.33, 0.27), 0.6, 0.6), 1.3, 0.1, (0, 0, 0.25))
    stage.scan("fish", enamel((0.55, 0.13, 0.05), (0.75, 0.55, 0.2), 5.0, 0.45), 1.5, (0, 0, -0.6), (0, -25, 40))


def hammer(stage: Stage) -> None:
    """A hammer with a head of steel, on a block of wood."""
    stage.scan("hammer", steel_and_ash(), 2.4, (0, 0, -0.255), (0, 90, 0), LYING)
    stage.block(wood((0.16, 0.09, 0.05), (0.34, 0.21, 0.12), 1.8, 0.6), (1.5, 1.5, 0.35), (0, 0, -0.43), 0.05)


SCENES: Sequence[Callable[[Stage], None]] = (
    spot, workbench, shoal, boot, nefertiti, orators, trophy, still_life, grotto, hammer
)  # fmt: skip


def main(meshes: str, out: str, *names: str) -> None:
    """Write one file a scene."""
    for build in SCENES:
        if not names or build.__name__ in names:
            build(Stage(Path(meshes)))
            bpy.ops.wm.save_as_mainfile(filepath=str(Path(out).absolute() / f"{build.__name__}.blend"), compress=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
