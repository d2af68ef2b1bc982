"""Progress: plain lines where standard error is no terminal."""

from common.progress import Progress, progress


def test_yields_everything_and_prints_the_end(capsys):
    assert list(progress(iter("abc"), 3, "frames", "frame")) == list("abc")
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("frames: 3/3 frame, ")
    assert "ETA 00:00" in err


def test_figures_are_shown_and_lines_are_rare(capsys):
    with Progress(4, "train", interval=1e9) as bar:
        for step in range(4):
            bar.update(loss=step)
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "loss=3" in err


def test_every_update_has_a_line_when_due(capsys):
    with Progress(5, "x", initial=2, interval=0) as bar:
        bar.update(2)
        bar.update()
    assert [line.split(",")[0] for line in capsys.readouterr().err.splitlines()] == [
        "x: 4/5 it",
        "x: 5/5 it",
    ]
