"""Folders of C code for controllers: `socontrol.codegen(robot_or_problem, folder, functions=...)`."""

import sys
import types


class _Codegen(types.ModuleType):
    """This package, which is also the public function of its name."""

    def __call__(self, subject, folder, functions=None, real="double", force=False):
        """Write the folder of C code of a Robot, a question, or the file of one; see `folder.write`."""
        from socontrol.codegen.folder import write

        return write(subject, folder, functions, real=real, force=force)


sys.modules[__name__].__class__ = _Codegen
codegen = sys.modules[__name__]
