"""Algorithm source: a user's algorithm as text and numbers, so that another process can make the same one.

The text of an algorithm in a file is the file. That of one in a notebook is its class, with the functions and
classes of the notebook that it uses, and the imports. What else it uses cannot travel, and is refused by
name: an open file, a table, the result of a run. Whoever runs the text trusts whoever sent it.
"""

from __future__ import annotations

import ast
import builtins
import copy
import hashlib
import linecache
import sys
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

from lab.base.python_file import describe_error
from lab.navigation.algorithm import Algorithm, AlgorithmError

_ACCEPTED = (
    "accepted are imports, functions and classes at the top of a cell, numbers, text and arrays; or load the "
    "algorithm from a file of its own, which travels as a whole"
)
_DATA = (bool, int, float, complex, str, bytes, type(None), np.ndarray, np.generic)
_RUNNING = threading.RLock()
"""Two threads of a worker do not run the same text."""
Definition = ast.ClassDef | ast.FunctionDef | ast.Assign


@dataclass(frozen=True)
class AlgorithmSource:
    """The source of an algorithm.

    Attributes
    ----------
    name : str
        Name of its class.
    text : str
        Python text that defines the class.
    values : dict
        Numbers, text and arrays that the text uses by their names.
    state : dict
        Attributes of the object.
    """

    name: str
    text: str
    values: dict[str, Any]
    state: dict[str, Any]

    @classmethod
    def of(cls, algorithm: Algorithm) -> AlgorithmSource:
        """Return the source of an algorithm.

        Raises
        ------
        AlgorithmError
            If it cannot travel: the message says what of it cannot, and what is accepted.
        """
        kind, state = type(algorithm), getattr(algorithm, "__dict__", None)
        name, home = kind.__name__, sys.modules.get(kind.__module__)
        if kind.__qualname__ != name or state is None:
            what = "has __slots__" if state is None else f"is made inside {kind.__qualname__.split('.')[0]}"
            raise AlgorithmError(f"{name}: {what}, so it cannot travel to another process; {_ACCEPTED}")
        for attribute, value in state.items():
            if not _is_data(value):
                raise _cannot_travel(name, f"its attribute {attribute}", value)
        file = getattr(home, "__file__", None)
        if home is not None and file is not None and kind.__module__ != "__main__":
            text, values = "".join(linecache.getlines(file)), dict[str, Any]()
        else:
            gathered = _Gathered(name, vars(sys.modules[kind.__module__]))
            gathered.add(name)
            text, values = gathered.text, gathered.values
        return cls(name, text, *copy.deepcopy((values, state)))  # a run may change them

    @property
    def digest(self) -> str:
        """Digest of all of it."""
        return _digest(self.name, self.text, _comparable_value(self.values), _comparable_value(self.state))

    def made(self) -> Algorithm:
        """Run the text, and return the algorithm with the attributes that it had.

        Raises
        ------
        AlgorithmError
            If that fails, such as for an import of a file that is not there.
        """
        try:
            made: Algorithm = object.__new__(getattr(self._module(), self.name))
        except (Exception, SystemExit) as error:
            reason = describe_error(error)
            raise AlgorithmError(f"{self.name}: cannot be made from its source: {reason}") from error
        vars(made).update(copy.deepcopy(self.state))
        return made

    def _module(self) -> ModuleType:
        """Return the module of the text; it is run once, because what it compiles takes long."""
        name = f"algorithm_{_digest(self.text, _comparable_value(self.values))[:12]}"
        with _RUNNING:
            if name in sys.modules:
                return sys.modules[name]
            module = ModuleType(name)
            file = module.__file__ = f"{name}.py"
            # A traceback finds the lines here.
            linecache.cache[file] = len(self.text), None, self.text.splitlines(True), file
            vars(module).update(copy.deepcopy(self.values))
            sys.modules[name] = module  # dataclasses look it up there
            try:
                exec(compile(self.text, file, "exec"), vars(module))
            except BaseException:
                del sys.modules[name]
                raise
        return module


class _Gathered:
    """What the definition of a name in a notebook needs: definitions in their order, and values."""

    def __init__(self, algorithm: str, scope: Mapping[str, Any]) -> None:
        self._algorithm, self._scope = algorithm, scope
        self._seen: set[str] = set()
        self._parts: list[str] = ["from __future__ import annotations\n"]
        self.values: dict[str, Any] = {}

    @property
    def text(self) -> str:
        """The definitions."""
        return "\n".join(self._parts)

    def add(self, name: str) -> None:
        """Add what a name stands for, after all that it needs itself."""
        if name in self._seen or name not in self._scope:
            return  # a name of the definition's own, or of Python
        self._seen.add(name)
        value = self._scope[name]
        if isinstance(value, ModuleType):
            self._parts.append(f"import {value.__name__} as {name}\n")
        elif _is_data(value):
            self.values[name] = value
        elif _is_importable(value):
            self._parts.append(f"from {value.__module__} import {value.__qualname__} as {name}\n")
        else:
            node, text = self._definition(name, value)
            used = _Names()
            used.visit(node)
            for other in used.found:
                self.add(other)
            self._parts.append(text)

    def _definition(self, name: str, value: object) -> tuple[Definition, str]:
        """Return the last definition of a name, and its text."""
        for lines in _sources(value):
            try:
                tree = ast.parse("".join(lines))
            except SyntaxError:
                continue
            for node in reversed(tree.body):
                if isinstance(node, Definition) and _defines_name(node, name):
                    above = [one.lineno for one in getattr(node, "decorator_list", ())]
                    return node, "".join(lines[min([node.lineno, *above]) - 1 : node.end_lineno]) + "\n"
        raise _cannot_travel(self._algorithm, f"{name}, which it uses,", value)


class _Names(ast.NodeVisitor):
    """The names that a definition uses, besides those in annotations."""

    def __init__(self) -> None:
        self.found: list[str] = []

    def visit_Name(self, node: ast.Name) -> None:
        """Note a name."""
        self.found.append(node.id)

    def visit_arg(self, node: ast.arg) -> None:
        """Leave out the annotation of an argument."""

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        """Leave out the annotation of what a function returns."""
        node.returns = None
        self.generic_visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        """Leave out the annotation of a variable."""
        if node.value is not None:
            self.visit(node.value)


def _defines_name(node: Definition, name: str) -> bool:
    """Return whether a statement defines a name."""
    if isinstance(node, ast.Assign):
        return any(isinstance(target, ast.Name) and target.id == name for target in node.targets)
    return node.name == name


def _sources(value: object) -> Iterator[list[str]]:
    """Iterate over the lines of the cells or files in which a function or class may be defined."""
    parts = [value, *vars(value).values()] if isinstance(value, type) else [value]
    functions = (getattr(part, "py_func", getattr(part, "__func__", part)) for part in parts)
    files = [one.__code__.co_filename for one in functions if isinstance(one, FunctionType)]
    for file in dict.fromkeys(files):
        yield linecache.getlines(file)
    if isinstance(value, type):  # one without functions: in any cell
        cells = [file for file in linecache.cache if "ipykernel" in file]
        yield from map(linecache.getlines, reversed(cells))


def _is_data(value: object) -> bool:
    """Return whether a value is made of numbers, text and arrays."""
    if isinstance(value, dict):
        return all(map(_is_data, (*value.keys(), *value.values())))
    if type(value) in (list, tuple, set, frozenset):
        return all(map(_is_data, value))  # type: ignore[call-overload]
    return isinstance(value, _DATA) and getattr(value, "dtype", None) != np.dtype(object)


def _is_importable(value: object) -> bool:
    """Return whether a function or class is found where it says that it is, outside the notebook."""
    home, name = getattr(value, "__module__", None), getattr(value, "__qualname__", "")
    if home in (None, "__main__") or not name.isidentifier():
        return False
    return getattr(sys.modules.get(str(home), builtins), name, None) is value


def _digest(*parts: object) -> str:
    return hashlib.sha256(repr(parts).encode()).hexdigest()


def _comparable_value(value: Any) -> object:
    """Return a value in a form whose text tells it apart; that of a large array does not."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, dict):
        return [(key, _comparable_value(one)) for key, one in value.items()]
    return [_comparable_value(one) for one in value] if isinstance(value, list | tuple) else value


def _cannot_travel(algorithm: str, what: str, value: object) -> AlgorithmError:
    return AlgorithmError(
        f"{algorithm}: {what} is of type {type(value).__name__} and cannot travel to another process; "
        f"{_ACCEPTED}"
    )
