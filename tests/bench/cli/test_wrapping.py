"""On a terminal sentences are wrapped between words; for programs and pipes nothing is."""

import sys

import pytest

from radiogs_bench.cli.reporter import complain, say, say_whole, wrapped

SENTENCE = (
    "changing the roughness of everything by 0.1 changes the error by 0.000 to 0.001 dB; that is less than 8 bits"
)


def test_no_word_and_no_number_is_cut() -> None:
    for width in range(16, 120):
        lines = wrapped(SENTENCE, width).split("\n")
        assert max(map(len, lines)) <= width
        assert " ".join(lines) == SENTENCE
    path = "out/of/a/folder/whose/name/is/longer/than/the/terminal"
    assert path in wrapped(f"the page is in {path} now", 20).split("\n")


def test_a_command_to_copy_stays_in_one_piece_and_a_list_keeps_its_margin() -> None:
    command = "radiogs-bench score FOLDER --scene SCENE --into out/ablations --row 'another row'"
    assert wrapped(f"It is outdated. Score it again:  {command}", 40).split("\n")[-1].strip() == command
    lines = wrapped("  rows: ours, no-rad, detach-pbr, detach-surfel, nvs-init", 30).split("\n")
    assert len(lines) > 1
    assert all(line.startswith("  ") for line in lines)


def test_only_a_terminal_gets_wrapped_lines(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    say(SENTENCE)
    assert capsys.readouterr().out == f"{SENTENCE}\n"
    for stream in (sys.stdout, sys.stderr):
        monkeypatch.setattr(stream, "isatty", lambda: True, raising=False)
    say(SENTENCE)
    complain(f"error: {SENTENCE}\n(exit code 3)")
    shown, complained = capsys.readouterr()
    assert shown == f"{wrapped(SENTENCE, 40)}\n"
    assert complained.endswith("\n(exit code 3)\n")
    say_whole(SENTENCE)
    assert capsys.readouterr().out == f"{SENTENCE}\n"
