"""What is refused, how it is said, and what ends a solve."""

import pickle
import signal
import subprocess
import sys
import threading
import time
import warnings

import bromwich
import numpy as np
import pytest


@pytest.mark.parametrize(
    ("change", "argument"),
    [
        (dict(x0=[1.0, 2.0]), "x0"),
        (dict(x0=None), "x0"),
        (dict(A=[[np.nan]]), "A"),
        (dict(A=[[1.0, 2.0]]), "A"),
        (dict(A="-1"), "A"),
        (dict(A=None), "A"),
        (dict(B=[[1j]]), "B"),
        (dict(M=np.eye(2)), "M"),
        (dict(T=-1), "T"),
        (dict(T=None), "T"),
        (dict(g=[1.0, 2.0, 3.0, "t"]), "g"),
        (dict(g="sin("), "g"),
        (dict(g=lambda t: [1.0, 2.0]), "g"),
        (dict(g=lambda t: "one"), "g"),
        (dict(g=lambda t: np.nan), "g"),
        (dict(f=np.zeros((5, 3))), "f"),
        (dict(lcp_class="Q"), "lcp_class"),
        (dict(free=[3]), "free"),
        (dict(breakpoints=[5.0]), "breakpoints"),
        (dict(steps=0), "steps"),
        (dict(steps=2.5), "steps"),
        (dict(tol=2), "tol"),
        (dict(tol=0), "tol"),
        (dict(tol="1e-3"), "tol"),
        (dict(steps="400"), "steps"),
        (dict(max_steps=0.5), "max_steps"),
        (dict(T="2 s"), "T"),
        (dict(g=lambda t: None), "g"),
        (dict(g=([0.0, 1.0, 2.0], [0.0, 1.0])), "g"),
        (dict(g="-a*t", parameters={"a": "x"}), "parameters['a']"),
        (dict(parameters=3), "parameters"),
        (dict(states=0), "states"),
        (dict(states=["v"]), "states"),
        (dict(states=[0.5]), "states"),
        (dict(names=["v"]), "names"),
        (dict(names={"v": ["v"]}), "names"),
        (dict(names={"x": ["v", "i"]}), "names"),
        (dict(names={"x": ["v"], "y": ["v"]}), "names"),
        (dict(units={"x": ["V", "A"]}), "units"),
        (dict(check="raise"), "check"),
        (dict(progress=3), "progress"),
        (dict(stop=True), "stop"),
        (dict(atol=-1), "atol"),
        (dict(iteration_tol=-1), "iteration_tol"),
        (dict(method="automatic"), "method"),
        (dict(backend="gpu"), "backend"),
        (dict(states=[7]), "states"),
        (dict(states="some"), "states"),
        (dict(E0=np.eye(1)), "ET"),
    ],
)
def test_refused(diode, change, argument):
    with pytest.raises(bromwich.Error) as caught:
        bromwich.solve(**{**diode, **change})
    assert caught.value.argument == argument
    assert str(caught.value).startswith(argument)
    assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(A=np.ma.masked_array([[-1.0]], mask=[[True]])), "A: has masked entries; fill them, as with .filled(0)"),
        (dict(g=[[0.0, 1.0, 2.0], [0.0, -1.0, 0.0]]), "g: has 3 columns; give 1, or times of your own in a tuple, g=(times, values)"),
        (dict(g="1/t"), "g: at t = 0 entry (0) is inf; make every entry finite"),
    ],
)
def test_messages(diode, change, message):
    with pytest.raises(bromwich.Error) as caught:
        bromwich.solve(**{**diode, **change})
    assert str(caught.value) == message


def test_messages_of_results(diode, tmp_path):
    """Of pictures, derivatives and files: the argument, what was found, and what to do."""
    r = bromwich.solve(**diode, g="-sin(t)", steps=20)
    pytest.importorskip("matplotlib").use("Agg")
    texts = {"a.npz": "no archive", "b.csv": "t,y0\n1,x\n", "c.csv": "t,y0\n0,1,2\n"}
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    for call, message in (
        (lambda: r.plot("y", components=[1]), "components: found 1; give columns from 0 to 0"),
        (lambda: r.derivative().jvp(x0=[1j]), "x0: is complex; give real values"),
        (lambda: r.derivative().vjp(y="a"), "y: is an array of <U1; give numbers"),
        (lambda: bromwich.load(tmp_path / "a.npz"), f"path: {str(tmp_path / 'a.npz')!r} holds no result"),
        (lambda: bromwich.load(tmp_path / "b.csv"), f"path: {str(tmp_path / 'b.csv')!r}, line 2: could not convert"),
        (lambda: bromwich.load(tmp_path / "c.csv"), f"path: {str(tmp_path / 'c.csv')!r}, line 2: has 3 values under 2 names"),
    ):
        with pytest.raises(bromwich.Error) as caught:
            call()
        assert str(caught.value).startswith(message)


def test_an_operator_of_scipy_is_no_matrix(diode):
    linalg = pytest.importorskip("scipy.sparse.linalg")
    with pytest.raises(bromwich.Error, match=r"^A: is an operator; give a matrix, or bromwich.Dynamics"):
        bromwich.solve(**{**diode, "A": linalg.aslinearoperator(-np.eye(1))})


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_functions_that_are_not_finite_end_the_solve_alone(diode, value):
    """The status says so; nothing of how the function was examined is heard."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        r = bromwich.solve(**diode, g=lambda t: np.where(np.asarray(t) > 1, value, -1.0), check=False)
    assert r.status == "nonfinite" and r.reason.startswith("g is not finite at t = 1.0")


def test_misspelt_argument(diode):
    with pytest.raises(TypeError, match=r"'stepz' \(did you mean 'steps'\?\)"):
        bromwich.solve(**diode, stepz=100)
    for solve in (bromwich.solve_batch, bromwich.solve_nonlinear):
        with pytest.raises(TypeError, match=rf"^{solve.__name__}\(\) got .*'stepz' \(did you mean 'steps'\?\)"):
            solve(**diode, stepz=100)
    with pytest.raises(bromwich.Error, match=r"method: found 'newtn' \(did you mean 'newton'\?\); use auto, march, iteration"):
        bromwich.solve_nonlinear(**diode, method="newtn")
    with pytest.raises(TypeError, match=r"'C' \(did you mean 'N'\?\)"):  # of Siconos
        bromwich.solve(A=-1, B=1, C=1, D=1, x0=0, T=1)
    with pytest.raises(bromwich.Error, match=r"'w', which is not defined; define it in parameters=\{...\}, or use"):
        bromwich.solve(**diode, g="sin(w*t)")
    with pytest.raises(bromwich.Error, match=r"scene: is the name 'my.toml'; give bromwich.Scene.from_toml\('my.toml'\)"):
        bromwich.solve("my.toml")
    with pytest.raises(bromwich.Error, match=r"scene: is a dict; give a bromwich.Scene, or its entries by name"):
        bromwich.solve(diode)
    for word, meant in (("automatic", "auto"), ("marc", "march"), ("multi-grid", "multigrid")):
        with pytest.raises(bromwich.Error, match=rf"method: found '{word}' \(did you mean '{meant}'\?\); use one of auto"):
            bromwich.solve(**diode, method=word)
    with pytest.raises(bromwich.Error, match="scene: found 'signorin' .did you mean 'signorini'"):
        bromwich.scene("signorin")
    with pytest.raises(bromwich.Error, match="q: is no parameter of scene signorini .did you mean 'Q'"):
        bromwich.scene("signorini", q=3)


def test_does_not_fit(diode):
    with pytest.raises(bromwich.DoesNotFit) as caught:
        bromwich.solve(**diode, steps=400, memory_limit=10)
    assert isinstance(caught.value, MemoryError) and isinstance(caught.value, bromwich.Error)


def test_errors_can_be_pickled():
    error = bromwich.Error("x0: is wrong", "x0")
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error) and again.argument == "x0"


def test_sources_that_raise(diode):
    def g(t):
        if np.ndim(t) == 0 and t > 1:
            raise KeyError("behind 1")
        return -np.asarray(t) if np.ndim(t) == 0 else None

    with pytest.raises(KeyError, match="behind 1"):
        bromwich.solve(**diode, g=g)


def infeasible():
    """x = 0 and 0 = w = x - t < 0 for every y: no solution from the first step on."""
    return dict(A=0, B=0, N=1, M=0, g=lambda t: 0.5 - t, x0=0, T=1, steps=20)


def test_not_solved_warns():
    with pytest.warns(bromwich.NotSolvedWarning, match="infeasible"):
        r = bromwich.solve(**infeasible())
    assert r.status == "infeasible" and not r.ok and r.reason
    assert 0.5 <= r.infeasible_at <= 0.56
    assert np.isnan(r.y[-1, 0]) and r.y[5, 0] == 0


def test_not_solved_raises_where_asked():
    with pytest.raises(bromwich.NotSolved) as caught:
        bromwich.solve(**infeasible(), check=True)
    assert caught.value.result.status == "infeasible"


def test_not_solved_is_silent_where_asked():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not bromwich.solve(**infeasible(), check=False).ok


def long_solve(diode):
    """Steps enough for many seconds of Radau IIA and marching."""
    return bromwich.Scene(**diode, g=lambda t: -np.sin(t)), dict(steps=1 << 22, method="march", states=None)


def test_progress(Q15):
    seen = []
    bromwich.solve(Q15, steps=20000, method="contour", progress=lambda *p: seen.append(p), check=False)
    done, total, change = seen[-1]
    assert isinstance(done, int) and isinstance(total, int) and isinstance(change, float)


def test_progress_line():
    """Ten steps a second on a clock of our own: after 2 s 20 of 100 steps are done, and 8 s are left."""
    from bromwich._progress import ProgressLine, duration

    now, lines = [0.0], []
    line = ProgressLine(1e-12, lines.append, lambda: now[0])
    for k in range(21):
        now[0] = k / 10
        line(k, 100, 0.0)
    assert lines[0] == "step 10 of 100, about 9 s left"  # nothing in the first second
    assert lines[-1] == "step 20 of 100, about 8 s left"
    line.close()
    assert lines[-1] == ""
    assert [duration(s) for s in (6.2, 200, 18600)] == ["7 s", "3 min 20 s", "5 h 10 min"]


def test_progress_in_a_notebook_is_one_display_that_changes(monkeypatch):
    """IPython with a kernel: the line is displayed once, updated after that, and empty at the end."""
    import sys
    import types

    from bromwich import _progress

    shown = []

    class Handle:
        def update(self, data, raw):
            shown.append(data["text/plain"])

    def display(data, raw, display_id):
        assert raw and display_id
        shown.append("first: " + data["text/plain"])
        return Handle()

    ipython = types.ModuleType("IPython")
    ipython.get_ipython = lambda: types.SimpleNamespace(kernel=object())
    ipython.display = types.ModuleType("IPython.display")
    ipython.display.display = display
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    monkeypatch.setitem(sys.modules, "IPython.display", ipython.display)
    monkeypatch.setattr(_progress, "QUIET", 0.0)
    monkeypatch.setattr(_progress, "PAUSE", 0.0)
    with _progress.reporting(True, 1e-12) as report:
        report(1, 10, 0.0)
        report(2, 10, 0.0)
    assert shown[0] == "first: step 1 of 10"
    assert shown[1].startswith("step 2 of 10, about ")
    assert shown[-1] == ""


def test_progress_line_is_silent_without_a_terminal(Q15, capfd):
    bromwich.solve(Q15, steps=200, progress=True, check=False)
    assert capfd.readouterr().err == ""


def test_progress_that_raises(Q15):
    def progress(done, total, change):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        bromwich.solve(Q15, steps=20000, method="contour", progress=progress)


def test_stop(Q15):
    r = bromwich.solve(Q15, steps=20000, method="march", stop=lambda: True)
    assert r.status == "interrupted"


def test_ctrl_c_keeps_what_is_valid(diode, ctrl_c):
    scene, options = long_solve(diode)
    main = threading.main_thread().ident
    timer = threading.Timer(0.5, lambda: signal.pthread_kill(main, signal.SIGINT))
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt) as caught:
            while True:
                bromwich.solve(scene, **options)
    finally:
        timer.cancel()
    if isinstance(caught.value, bromwich.Interrupted):  # otherwise it came between two solves
        assert caught.value.result.status == "interrupted"


def test_other_threads_run(Q15):
    """A thread counts while the library computes; with the lock held it would stand still."""
    counted, done = [0], threading.Event()

    def count():
        while not done.is_set():
            counted[0] += 1
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    try:
        start, before = time.perf_counter(), counted[0]
        while time.perf_counter() - start < 0.5:
            bromwich.solve(Q15, steps=20000, method="march")
        during = counted[0] - before
    finally:
        done.set()
        thread.join()
    assert during > 10


def test_solves_in_two_threads(diode):
    scene = bromwich.Scene(**diode, g=lambda t: -np.sin(3 * t))
    expected = bromwich.solve(scene).y
    found = [None] * 4

    def work(i):
        found[i] = bromwich.solve(scene).y

    threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for y in found:
        np.testing.assert_allclose(y, expected, atol=1e-14)


def test_the_command():
    found = subprocess.run([sys.executable, "-m", "bromwich", "--version"], capture_output=True, text=True)
    assert found.returncode == 0 and bromwich.__version__ in found.stdout


def frames(error):
    """Names of the functions that an exception came through."""
    trace, names = error.__traceback__, []
    while trace:
        names.append(trace.tb_frame.f_code.co_name)
        trace = trace.tb_next
    return names


class Mine(Exception):
    pass


def deep(*_):
    raise Mine("from below") from LookupError("the cause")


def callbacks():
    def at_first(t):
        return -1.0 if t < 1 else deep()

    def only_many(t):
        return -np.asarray(t) if np.size(t) < 20 else deep()

    system = dict(A=-1.0, B=1.0, N=1.0, M=1.0, x0=0.0, T=2.0, steps=100)
    operator = dict(M=1, x0=0, T=2, g=-1.0, steps=20)
    resolvent = lambda z: lambda R: R / (z + 1)
    dynamics = lambda **change: bromwich.Dynamics(1, [[1.0]], [[1.0]], **{"shifted": resolvent, "bound": (0, -1)} | change)
    long = dict(system, g="-sin(t)", steps=1 << 20, method="march", states=None)
    return {
        "g of one time": dict(system, g=at_first),
        "g of many times": dict(system, g=only_many),
        "f": dict(system, f=at_first),
        "preparing a shift": dict(operator, dynamics=dynamics(shifted=deep)),
        "solving": dict(operator, dynamics=dynamics(shifted=lambda z: deep)),
        "mass": dict(operator, x0=0.5, dynamics=dynamics(mass=deep)),  # of E x0
        "progress": dict(long, progress=deep),
        "stop": dict(long, stop=deep),
    }


@pytest.mark.parametrize("where", callbacks())
def test_callbacks_that_raise(where):
    """The exception itself, with its own traceback and cause, and nothing of ours around it."""
    with pytest.raises(Mine, match="^from below$") as caught:
        bromwich.solve(**callbacks()[where])
    assert frames(caught.value)[-1] == "deep"
    assert "solve" in frames(caught.value)
    assert isinstance(caught.value.__cause__, LookupError)
    assert bromwich.solve(A=-1, B=1, N=1, M=1, x0=0, T=1, g=-1.0).ok  # and the next solve is as ever
