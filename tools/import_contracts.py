"""Import contracts in which a package may import, or be imported by, only the listed packages.

`make lint` checks the contracts. Indirect imports are included.
"""

from __future__ import annotations

from collections.abc import Iterable

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output
from importlinter.domain.helpers import module_expressions_to_modules


class ImportsNothingBut(Contract):
    """Contract that modules import only the allowed packages, directly or indirectly.

    modules: packages whose imports are checked
    allowed: packages that the modules may import
    """

    modules = fields.ListField(subfield=fields.ModuleExpressionField())
    allowed = fields.ListField(subfield=fields.ModuleExpressionField())

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        """Return whether the contract is kept, with every import that leaves the allowed packages.

        An import counts if allowed modules alone connect it with a checked module.
        """
        inside = _within(graph, self.allowed) | _within(graph, self.modules)
        reached = _within(graph, self.modules)
        waiting = sorted(reached)
        found = set()
        while waiting:
            module = waiting.pop()
            for other in self._neighbors(graph, module):
                if other not in inside:
                    found.add(self._edge(module, other))
                elif other not in reached:
                    reached.add(other)
                    waiting.append(other)
        return ContractCheck(kept=not found, metadata={"imports": sorted(found), "graph": graph})

    def _neighbors(self, graph: ImportGraph, module: str) -> Iterable[str]:
        return graph.find_modules_directly_imported_by(module)

    def _edge(self, module: str, other: str) -> tuple[str, str]:
        return module, other

    def render_broken_contract(self, check: ContractCheck) -> None:
        """Print the imports that break the contract, with line numbers."""
        for importer, imported in check.metadata["imports"]:
            details = check.metadata["graph"].get_import_details(
                importer=importer, imported=imported
            )
            lines = ", ".join(f"l.{detail['line_number']}" for detail in details)
            output.print_error(f"- {importer} -> {imported} ({lines})", bold=False)
        output.new_line()


class ImportedByNothingBut(ImportsNothingBut):
    """Contract that modules are imported only by the allowed packages, directly or indirectly.

    modules: packages whose importers are checked
    allowed: packages that may import the modules
    """

    def _neighbors(self, graph: ImportGraph, module: str) -> Iterable[str]:
        return graph.find_modules_that_directly_import(module)

    def _edge(self, module: str, other: str) -> tuple[str, str]:
        return other, module


def _within(graph: ImportGraph, packages: Iterable[object]) -> set[str]:
    """Return the names of packages and of all modules in them.

    packages: expressions of import-linter for the packages
    """
    found = module_expressions_to_modules(graph, packages, as_packages=True)
    return {module.name for module in found}
