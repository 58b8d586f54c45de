# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The compiled copy of `haptic_accel.core.tick`: one C unit from the plain sections.

The sections are joined in the order of their imports; their text is unchanged. What Cython needs
besides it, the types, is read from their annotations. `loops.py` takes the place of numpy.
"""

from __future__ import annotations

import ast
import hashlib
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from shutil import copy2
from typing import Any, ClassVar

from setuptools import Distribution, Extension
from setuptools.command.build_ext import build_ext
from setuptools.errors import CompileError

PACKAGE = "haptic_accel.core.tick"
UNIT = "_compiled"
FLAGS = ["-O1", "-g0", "-ffp-contract=off", "-Wno-unreachable-code"]
"""Flags of the compiler. Products and sums must not be fused: results would differ from plain
Python's where the processor can do so."""

DIRECTIVES = {
    "language_level": 3,
    "annotation_typing": False,
    "auto_pickle": False,  # a copy of objects that share arrays would crash
    "infer_types": True,
    "boundscheck": False,
    "wraparound": True,
    "initializedcheck": False,
    "cdivision": False,
    "nonecheck": True,
}
"""Directives of Cython: the types are in the declarations, and division is Python's."""

LIBC = ("sqrt", "tanh", "exp", "expm1", "log", "copysign", "fabs")
"""Functions of `math` that are taken from C; rounding and tests of numbers are in `loops.py`."""

OWN = ("floor", "isfinite", "isnan")

TYPES = {
    "float": "double",
    "int": "long",
    "bool": "bint",
    "FloatArray": "double[::1]",
    "FloatMatrix": "double[:, ::1]",
    "None": "void",
}
FAILING = {"double": " except? -1e300", "long": " except? -1", "bint": " except? -1"}
"""Results that may stand for an exception, by type; void is always asked."""

PLAIN_NODES = (
    *(ast.Lambda, ast.GeneratorExp, ast.FunctionDef, ast.Yield, ast.YieldFrom),
    *(ast.Import, ast.ImportFrom),
)
"""Nodes left to Python: a function with one of these in it, as a set-up function that imports
numpy, has no types."""


class Section:
    """One file, as a tree and as lines of text."""

    def __init__(self, path: Path) -> None:
        self.text = path.read_text(encoding="utf-8")
        self.tree = ast.parse(self.text)
        modules = [
            node.module or "" for node in self.tree.body if isinstance(node, ast.ImportFrom)
        ]
        self.needs = {
            name.rpartition(".")[2] for name in modules if name.startswith(f"{PACKAGE}.")
        }

    def without(self, dropped: list[ast.stmt]) -> str:
        """Return the text without some statements, which become empty lines.

        A method that is called from that which replaces it is named with its class: a C function
        knows no `super`.
        """
        lines = self.text.splitlines()
        for node in self.tree.body:
            if isinstance(node, ast.ClassDef) and node.bases:
                above = rf"{ast.unparse(node.bases[0])}.\1(self, "
                for line in range(node.lineno - 1, node.end_lineno or 0):
                    lines[line] = re.sub(r"\bsuper\(\)\.(?!__)(\w+)\(", above, lines[line])
        for node in dropped:
            for line in range(node.lineno - 1, node.end_lineno or 0):
                lines[line] = ""
        return "\n".join(lines) + "\n"


def sections(folder: Path) -> dict[str, Section]:
    """Return the sections by name, each after those that it imports."""
    files = {each.stem: Section(each) for each in folder.glob("[a-z]*.py")}
    found: dict[str, Section] = {}
    while len(found) < len(files):
        ready = [name for name in sorted(files) if files[name].needs <= found.keys()]
        new = [name for name in ready if name not in found]
        if not new:
            raise CompileError(f"sections import each other: {sorted(files.keys() - found)}")
        found[new[0]] = files[new[0]]
    return found


def digest(folder: Path) -> str:
    """Return what tells whether a unit is of these sections; as in `core/tick/_unit.py`."""
    return hashlib.sha256(
        b"".join(each.read_bytes() for each in sorted(folder.glob("[a-z]*.py")))
    ).hexdigest()


def stamp(folder: Path) -> str:
    """Return what a built file holds as C text, which tells from what it was made."""
    parts = [*sorted(folder.glob("[a-z]*.py")), *sorted(Path(__file__).parent.glob("*.py"))]
    text = b"".join(each.read_bytes() for each in parts)
    return f"made from {hashlib.sha256(text).hexdigest()}"


def _is_dropped(node: ast.stmt, names: set[str]) -> bool:
    """Return whether a statement of a section has no place in the unit."""
    if isinstance(node, ast.Import):
        return node.names[0].name == "math"
    if isinstance(node, ast.ImportFrom):
        return node.module == "__future__" or (node.module or "").startswith(PACKAGE)
    if isinstance(node, ast.If):
        return ast.unparse(node.test) == "TYPE_CHECKING"
    return isinstance(node, ast.FunctionDef) and node.name in names


class Unit:
    """Text and declarations of the unit.

    Parameters
    ----------
    folder : Path
        Folder of the sections.

    Raises
    ------
    CompileError
        Two sections have a name in common, or import each other.
    """

    def __init__(self, folder: Path) -> None:
        loops = Section(Path(__file__).with_name("loops.py"))
        in_loops = {node.name for node in loops.tree.body if isinstance(node, ast.FunctionDef)}
        files = sections(folder)
        self._kept: list[ast.stmt] = []
        parts = ["from __future__ import annotations\nimport math as python_math\n"]
        for name, section in [("loops", loops), *files.items()]:
            replaced = in_loops if name == "kernels" else set()
            dropped = [node for node in section.tree.body if _is_dropped(node, replaced)]
            self._kept += [node for node in section.tree.body if node not in dropped]
            parts.append(section.without(dropped))
        self._classes = {node.name: node for node in self._kept if isinstance(node, ast.ClassDef)}
        self._constants = {
            node.target.id: self._type(node.annotation)
            for node in self._kept
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
            if ast.unparse(node.annotation) in ("float", "int", "bool")
        }
        self._check_names()
        parts.append(f"SECTIONS = {sorted(files)!r}\nDIGEST = {digest(folder)!r}\n")
        shown = ", ".join(f"{name!r}: {name}" for name in self._constants)
        parts.append(f"globals().update({{{shown}}})\n")
        self.text = re.sub(r"\bmath\.(\w+)", _function_of_c, "\n".join(parts))
        made_from = f'const char haptic_accel_tick[] = "{stamp(folder)}";'
        verbatim = f'cdef extern from *:\n    """{made_from}"""\n    pass\n'
        self.declarations = "\n".join(self._declared()) + "\n" + verbatim

    def _check_names(self) -> None:
        seen: set[str] = set()
        for node in self._kept:
            if isinstance(node, (ast.ClassDef, ast.FunctionDef)):
                if node.name in seen:
                    raise CompileError(f"two sections have the name {node.name}")
                seen.add(node.name)

    def _declared(self) -> Iterator[str]:
        yield "cimport cython\nfrom libc cimport math"
        yield from (f"cdef {kind} {name}" for name, kind in self._constants.items())
        compiled = [node for node in self._classes.values() if self._is_compiled(node)]
        yield from (f"cdef class {node.name}" for node in compiled)
        for node in compiled:
            yield f"cdef class {node.name}({', '.join(map(ast.unparse, node.bases))}):"
            inherited = self._attributes_of_bases(node)
            for name, kind in self._attributes(node).items():
                if name not in inherited:
                    yield f"    cdef public {kind} {name}"
            for each in node.body:
                if isinstance(each, ast.FunctionDef):
                    yield from ("    " + line for line in self._function(each, node.name))
            yield "    pass"
        for statement in self._kept:
            if isinstance(statement, ast.FunctionDef):
                yield from self._function(statement)

    def _is_compiled(self, node: ast.ClassDef) -> bool:
        """Return whether a class, with its bases, is one of the sections alone."""
        return all(
            isinstance(base, ast.Name)
            and base.id in self._classes
            and self._is_compiled(self._classes[base.id])
            for base in node.bases
        ) and not (node.decorator_list or node.keywords)

    def _attributes_of_bases(self, node: ast.ClassDef) -> set[str]:
        return {
            name
            for base in node.bases
            for above in [self._classes[ast.unparse(base)]]
            for name in (*self._attributes(above), *self._attributes_of_bases(above))
        }

    def _function(self, node: ast.FunctionDef, own: str = "") -> Iterator[str]:
        """Yield the declaration of a function, unless it stays Python's."""
        arguments = node.args
        inside = [each for each in ast.walk(node) if each is not node]
        if (
            node.decorator_list
            or node.name.startswith("__")
            or node.returns is None
            or arguments.vararg
            or arguments.kwarg
            or arguments.kwonlyargs
            or any(isinstance(each, PLAIN_NODES) for each in inside)
        ):
            return
        typed = [(each.arg, self._type(each.annotation)) for each in arguments.args]
        first = len(typed) - len(arguments.defaults)
        words = [
            name if own and index == 0 else f"{kind} {name}{'=*' if index >= first else ''}"
            for index, (name, kind) in enumerate(typed)
        ]
        kind = self._type(node.returns)
        known = {name for name, _ in typed}
        local = {
            each.target.id: self._type(each.annotation)
            for each in inside
            if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name)
        }
        local = {**self._looped(node, own), **local}
        local = {name: each for name, each in local.items() if name not in known}
        if local:
            words_of = (f"{name}={_as_decorated(each)}" for name, each in local.items())
            yield f"@cython.locals({', '.join(words_of)})"
        failing = FAILING.get(kind, " except *" if kind == "void" else "")
        yield f"cpdef {kind} {node.name}({', '.join(words)}){failing}"

    def _looped(self, node: ast.FunctionDef, own: str) -> dict[str, str]:
        """Return the types of what comes from lists of one class, or of floats, in a function."""
        lists = {each.arg: self._element(each.annotation) for each in node.args.args}
        place = self._classes.get(own)
        while place:
            for each in ast.walk(place):
                if isinstance(each, ast.AnnAssign):
                    lists.setdefault(ast.unparse(each.target), self._element(each.annotation))
            place = self._classes.get(ast.unparse(place.bases[0])) if place.bases else None
        found: dict[str, set[str]] = {}
        for each in ast.walk(node):
            if isinstance(each, (ast.For, ast.comprehension)) and isinstance(
                each.target, ast.Name
            ):
                kind = lists.get(ast.unparse(each.iter), "")
                found.setdefault(each.target.id, set()).add(kind)
            elif isinstance(each, ast.Assign):
                for target, value in _pairs(each):
                    if (
                        isinstance(target, ast.Name)
                        and isinstance(value, ast.Subscript)
                        and not isinstance(value.slice, ast.Slice)
                        and lists.get(ast.unparse(value.value)) == "double"
                    ):
                        found[target.id] = {"double"}
        return {
            name: kinds.pop() for name, kinds in found.items() if len(kinds) == 1 and all(kinds)
        }

    def _element(self, annotation: ast.expr | None) -> str:
        """Return the class of a list's elements, double for floats, empty for others."""
        if isinstance(annotation, ast.Subscript) and ast.unparse(annotation.value) == "list":
            name = self._type(annotation.slice)
            return name if name in self._classes or name == "double" else ""
        return ""

    def _attributes(self, node: ast.ClassDef) -> dict[str, str]:
        """Return the attributes that a class sets itself, with their types."""
        found: dict[str, str] = {}
        for each in node.body:
            if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name):
                found[each.target.id] = self._type(each.annotation)
        for method in node.body:
            if isinstance(method, ast.FunctionDef):
                known = {each.arg: self._type(each.annotation) for each in method.args.args}
                known.update(
                    (each.target.id, self._type(each.annotation))
                    for each in ast.walk(method)
                    if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name)
                )
                for target, kind in self._assigned(method, {**self._constants, **known}):
                    if kind != "object" or target not in found:
                        found.setdefault(target, kind)
        return found

    def _assigned(
        self, method: ast.FunctionDef, known: dict[str, str]
    ) -> Iterator[tuple[str, str]]:
        for node in ast.walk(method):
            if isinstance(node, ast.AnnAssign):
                yield from ((name, self._type(node.annotation)) for name in _own(node.target))
            elif isinstance(node, ast.Assign):
                for target, value in _pairs(node):
                    yield from ((name, self._kind(value, known)) for name in _own(target))

    def _kind(self, value: ast.expr | None, known: dict[str, str]) -> str:
        """Return the type of an expression, as far as it shows, else object."""
        if isinstance(value, ast.Constant):
            return (
                TYPES.get(type(value.value).__name__, "object")
                if value.value is not None
                else "object"
            )
        if isinstance(value, ast.Name):
            return known.get(value.id, "object")
        if isinstance(value, ast.UnaryOp):
            return "bint" if isinstance(value.op, ast.Not) else self._kind(value.operand, known)
        if isinstance(value, ast.Compare):
            return "bint"
        if isinstance(value, ast.BinOp):
            sides = {self._kind(value.left, known), self._kind(value.right, known)}
            if isinstance(value.left, ast.List):
                return "list"
            return "double" if sides in ({"double"}, {"double", "long"}) else "object"
        if isinstance(value, (ast.List, ast.ListComp)):
            return "list"
        if isinstance(value, ast.Call):
            name = ast.unparse(value.func)
            if name in self._classes and self._is_compiled(self._classes[name]):
                return name
            if name.startswith("math.") and name != "math.floor":
                return "bint" if name.startswith("math.is") else "double"
            return TYPES.get(name, "object")
        return "object"

    def _type(self, annotation: ast.expr | None) -> str:
        """Return the C type of an annotation."""
        if annotation is None:
            return "object"
        text = ast.unparse(annotation).strip("'").removesuffix(" | None")
        if text.startswith("list["):
            return "list"
        if text in self._classes:
            return text if self._is_compiled(self._classes[text]) else "object"
        return TYPES.get(text, "object")


def _function_of_c(found: re.Match[str]) -> str:
    """Return what a name of `math` is called in the unit."""
    name = found[1]
    return (
        f"own_{name}" if name in OWN else f"math.{name}" if name in LIBC else f"python_math.{name}"
    )


def _own(target: ast.expr) -> Iterator[str]:
    """Yield the name of an attribute of `self`."""
    if isinstance(target, ast.Attribute) and ast.unparse(target.value) == "self":
        yield target.attr


def _pairs(node: ast.Assign) -> Iterator[tuple[ast.expr, ast.expr | None]]:
    """Yield each target of an assignment with its value, None if that does not show."""
    for target in node.targets:
        if not isinstance(target, ast.Tuple):
            yield target, node.value
        elif isinstance(node.value, ast.Tuple):
            yield from zip(target.elts, node.value.elts, strict=True)
        else:
            yield from ((each, None) for each in target.elts)


def _as_decorated(kind: str) -> str:
    """Return a type as a decorator names it."""
    return f"cython.{kind}" if kind.split("[")[0] in ("double", "long", "bint") else kind


class BuildUnit(build_ext):  # type: ignore[misc]
    """Build of the unit; without Cython or a compiler there is none, and plain Python runs."""

    directives: ClassVar[dict[str, bool]] = {}
    """Directives of Cython that differ from `DIRECTIVES`."""

    def build_extension(self, ext: Any) -> None:
        """Generate the C text of the unit, and compile it, or take the fitting one in the folder.

        Dates do not count: another branch's sections may be older than the unit. To compile takes
        most of a minute, and an installation in place builds for each set of extras.
        """
        folder, made = Path(*PACKAGE.split(".")), Path(self.get_ext_fullpath(ext.name))
        known = folder / made.name
        if ext.optional and known.exists() and stamp(folder).encode() in known.read_bytes():
            made.parent.mkdir(parents=True, exist_ok=True)
            copy2(known, made)
            return
        ext.sources = [str(c_text(Path(self.build_temp), self.directives))]
        super().build_extension(ext)


def c_text(folder: Path, directives: Mapping[str, bool]) -> Path:
    """Write the unit in C into a folder, and return its path.

    Raises
    ------
    CompileError
        There is no Cython, or it refuses the text.
    """
    try:
        from Cython.Build import cythonize
        from Cython.Compiler.Errors import CompileError as Refused
    except ImportError:
        raise CompileError("Cython is not installed") from None
    unit = Unit(Path(*PACKAGE.split(".")))
    # Cython finds the declarations in the folder of a package only.
    text = folder.joinpath(*PACKAGE.split("."), f"{UNIT}.py")
    text.parent.mkdir(parents=True, exist_ok=True)
    for package in text.relative_to(folder).parents[:-1]:
        (folder / package / "__init__.py").touch()
    text.write_text(unit.text, encoding="utf-8")
    text.with_suffix(".pxd").write_text(unit.declarations, encoding="utf-8")
    try:
        (made,) = cythonize(
            [Extension(f"{PACKAGE}.{UNIT}", [str(text)])],
            compiler_directives={**DIRECTIVES, **directives},
            include_path=[str(folder)],
            force=True,
            quiet=True,
        )
    except Refused as error:
        raise CompileError(f"{UNIT}: {error}") from None
    return Path(made.sources[0])


def extension(optional: bool = True) -> Extension:
    """Return the unit as an extension; if optional, it is left out where it cannot be built."""
    return Extension(f"{PACKAGE}.{UNIT}", [], extra_compile_args=FLAGS, optional=optional)


def built(folder: Path, **directives: bool) -> Path:
    """Build the unit into a folder for tests, soon rather than fast, and return the file."""
    unit = extension(optional=False)
    unit.extra_compile_args = ["-O0", *FLAGS[1:]]
    command = BuildUnit(Distribution({"name": UNIT, "ext_modules": [unit]}))
    command.build_lib, command.build_temp = str(folder), str(folder / "temporary")
    command.directives = directives  # type: ignore[misc]
    command.ensure_finalized()
    command.run()
    return Path(command.get_ext_fullpath(f"{PACKAGE}.{UNIT}"))
