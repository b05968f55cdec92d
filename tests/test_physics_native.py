"""C++ that is compiled once, found again by its text or its key, and whole or not there at all; a BLAS for each thread."""

import ctypes

import numpy as np
import pytest

from physics import fem
from physics.linalg import native
from physics.linalg.native import blas, compiled, pointer
from physics.threads import loaded

SOURCE = 'extern "C" double twice(const double *x, int n) { double s = 0; for (int i = 0; i < n; ++i) s += 2 * x[i]; return s; }'


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(fem, "cache_folder", lambda: tmp_path / "made" / "here")
    return tmp_path / "made" / "here"


def test_a_source_is_compiled_once_and_called(folder, monkeypatch):
    library = compiled(SOURCE)
    library.twice.restype = ctypes.c_double
    x = np.array([1.0, 2.5, 4.0])
    assert library.twice(pointer(x), ctypes.c_int(3)) == 15.0
    (file,) = folder.iterdir()  # and no scratch left beside it
    assert file.name.startswith("kernel_") and file.suffix == ".so" and len(file.stem) == len("kernel_") + 32
    with monkeypatch.context() as patch:
        patch.setattr(native.subprocess, "run", lambda *a, **k: pytest.fail("compiled again"))
        compiled(SOURCE)
    compiled(SOURCE.replace("2 *", "3 *"))
    assert len(list(folder.iterdir())) == 2


def test_a_key_stands_for_a_source_that_is_not_written_again(folder):
    written = []

    def source():
        written.append(1)
        return SOURCE

    for key in (("a", "b"), ("a", "b"), ("a", "c"), ("a",)):
        compiled(source, *key)
    assert len(written) == 3 and len(list(folder.iterdir())) == 3


def test_other_options_make_another_library(folder, monkeypatch):
    compiled(SOURCE)
    monkeypatch.setattr(fem, "COMPILE", [*fem.COMPILE, "-g0"])
    compiled(SOURCE)
    assert len(list(folder.iterdir())) == 2


def test_what_does_not_compile_says_the_first_line_and_leaves_nothing(folder):
    with pytest.raises(RuntimeError, match="^g\\+\\+ could not compile a kernel: kernel.cpp:2:1: error: [^\n]*'?nonsense[^\n]*$"):
        compiled('extern "C" int f();\nnonsense;\nmore nonsense;')
    assert list(folder.iterdir()) == []


def test_the_address_is_that_of_the_numbers_which_lie_one_after_another():
    x = np.arange(6.0).reshape(2, 3)
    assert pointer(x[1]).value == x.ctypes.data + 24
    assert ctypes.cast(pointer(x), ctypes.POINTER(ctypes.c_double))[4] == 4.0
    with pytest.raises(AssertionError):
        pointer(x.T)


def test_products_and_sums_are_rounded_each_by_itself_on_request(folder):
    """(1 + e) (1 - e) - 1 for e = 2^-30: the product rounds to 1, and without that -e^2 would be left."""
    library = compiled('extern "C" double f(double a, double b, double c) { return a * b + c; }', rounded=True)
    library.f.restype, library.f.argtypes = ctypes.c_double, 3 * [ctypes.c_double]
    assert library.f(1 + 2**-30, 1 - 2**-30, -1.0) == 0.0


def test_every_thread_has_a_blas_that_it_may_call(folder):
    """OpenBLAS without threads has no lock: a copy for each, which multiplies alike; any other is shared. No copy stays on disk."""
    native.blas.cache_clear()
    native._copied.cache_clear()
    alone = any(hasattr(library, "dpotrf_") and library.openblas_get_parallel() == 0 for library in loaded("openblas"))
    assert len({blas("dgemm", thread) for thread in range(3)}) == (3 if alone else 1)
    assert blas("dgemm", 1) == blas("dgemm", 1) != blas("dsyrk", 1)
    assert list(folder.iterdir()) == [] if alone else not folder.exists()
    product = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 13)
    size, one, none = ctypes.c_int(5), ctypes.c_double(1), ctypes.c_double(0)
    a, b = np.random.default_rng(0).normal(size=(2, 5, 5))
    for thread in range(3):
        found = np.zeros((5, 5))
        at = ctypes.byref
        product(blas("dgemm", thread))(
            b"N", b"N", *[ctypes.cast(at(size), ctypes.c_void_p)] * 3, ctypes.cast(at(one), ctypes.c_void_p), pointer(b),
            ctypes.cast(at(size), ctypes.c_void_p), pointer(a), ctypes.cast(at(size), ctypes.c_void_p),
            ctypes.cast(at(none), ctypes.c_void_p), pointer(found), ctypes.cast(at(size), ctypes.c_void_p))
        assert found == pytest.approx(a @ b, rel=1e-12)
