"""Import contracts in which a package may import, or be imported by, only the listed packages.

`make lint` checks the contracts. Indirect imports are included.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output
from importlinter.domain.helpers import module_expressions_to_modules

#: Chain of modules, each of which imports the next one.
Chain = tuple[str, ...]


class ImportsNothingBut(Contract):
    """Contract that modules import only the allowed packages, directly or indirectly.

    modules: packages whose imports are checked
    allowed: packages that the modules may import
    """

    modules = fields.ListField(subfield=fields.ModuleExpressionField())
    allowed = fields.ListField(subfield=fields.ModuleExpressionField())

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        """Return whether the contract is kept, with the shortest chain of imports for each
        violation.

        A chain consists of the modules from the checked module to the first forbidden one.
        """
        allowed = _within(graph, self.allowed)
        found = {
            chain
            for module in sorted(_within(graph, self.modules))
            for chain in self._chains(graph, module, allowed)
        }
        # Keep the shortest chain for each import that leaves the allowed packages.
        shortest = {self._crossing(chain): chain for chain in sorted(found, key=len, reverse=True)}
        chains = sorted(shortest.values())
        return ContractCheck(kept=not chains, metadata={"chains": chains, "graph": graph})

    def _chains(self, graph: ImportGraph, module: str, allowed: set[str]) -> Iterable[Chain]:
        for other in graph.find_upstream_modules(module) - allowed:
            chain = graph.find_shortest_chain(importer=module, imported=other)
            if chain and allowed.issuperset(chain[:-1]):
                yield chain

    def _crossing(self, chain: Chain) -> Chain:
        return chain[-2:]

    def render_broken_contract(self, check: ContractCheck) -> None:
        """Print the chains of imports that break the contract, with line numbers."""
        for chain in check.metadata["chains"]:
            for importer, imported in pairwise(chain):
                details = check.metadata["graph"].get_import_details(
                    importer=importer, imported=imported
                )
                lines = ", ".join(f"l.{each['line_number']}" for each in details)
                output.print_error(f"- {importer} -> {imported} ({lines})", bold=False)
            output.new_line()


class ImportedByNothingBut(ImportsNothingBut):
    """Contract that modules are imported only by the allowed packages, directly or indirectly.

    modules: packages whose importers are checked
    allowed: packages that may import the modules
    """

    def _chains(self, graph: ImportGraph, module: str, allowed: set[str]) -> Iterable[Chain]:
        inside = allowed | _within(graph, self.modules)
        for other in graph.find_downstream_modules(module) - inside:
            chain = graph.find_shortest_chain(importer=other, imported=module)
            if chain and inside.issuperset(chain[1:]):
                yield chain

    def _crossing(self, chain: Chain) -> Chain:
        return chain[:2]


def _within(graph: ImportGraph, packages: Iterable[object]) -> set[str]:
    """Return the names of packages and of all modules in them.

    packages: expressions of import-linter for the packages
    """
    found = module_expressions_to_modules(graph, packages, as_packages=True)
    return {module.name for module in found}
