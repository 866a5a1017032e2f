"""python -m labkit.solve: compile the core and keep it on disk (once a machine, 15 s)."""

from .backend import load_core


def keep_loops_short() -> None:
    """Tell Numba, in this process, to let loops be loops.

    Those of the core run over two or three states. LLVM would unroll each eight times and add one
    for vectors: twice the code, and a run takes a fifth longer.
    """
    import llvmlite.binding as llvm
    from numba.core import codegen

    def builder(machine, opt=2, loop_vectorize=False, slp_vectorize=False):
        options = llvm.create_pipeline_tuning_options(int(opt))
        options.loop_vectorization = options.loop_interleaving = False
        options.loop_unrolling, options.slp_vectorization = False, slp_vectorize
        return llvm.create_pass_builder(machine, options)

    if hasattr(codegen, "create_pass_builder"):  # else another Numba's: only slower
        codegen.create_pass_builder = builder


if __name__ == "__main__":
    keep_loops_short()
    load_core(here=True)
