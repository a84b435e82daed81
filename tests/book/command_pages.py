#!/usr/bin/env python3
"""command_pages.py BROMWICH PAGES: the manual pages and completions in PAGES have every option of every command, and no
other. The options are read from the help of the command by another way than app/command_pages.sh reads them; bash
completes for itself, zsh and man check their files where they are installed."""

import re
import shutil
import subprocess
import sys
from pathlib import Path


def output(*command):
    return subprocess.run(command, check=True, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE).stdout


def options_of(help_text):
    """Every word that begins with - in the first column of the help."""
    return {word for line in help_text.splitlines() if line.startswith("  -") for word in line.split()[0].split(",")}


def commands_of(help_text):
    listed = help_text.split("Subcommands:\n")[1].split("\n\n")[0]
    return [line.split()[0] for line in listed.splitlines() if re.match(r"  \w", line)]


def completed(script, words, folder="."):
    """What bash offers for the last word, with the command in `folder`."""
    array = " ".join(f"'{word}'" for word in words)
    program = f"PATH='{folder}':$PATH; source '{script}'; COMP_WORDS=({array}); COMP_CWORD={len(words) - 1}; _bromwich; printf '%s\\n' \"${{COMPREPLY[@]}}\""
    return set(output("bash", "-c", program).split())


def in_manual(path):
    text = path.read_text(encoding="utf-8").replace("\\-", "-").replace("\\fB", "").replace("\\fR", "")
    return {word for line in text.splitlines() if line.startswith("-") for word in line.split()[0].split(",")}


def in_zsh(text, command):
    own = text.split(f"\n    {command})\n")[1].split(";;\n")[0]
    return set(re.findall(r"^\s+'\*?(-[\w-]+)\[", own, re.M))


def parameters_in_zsh(script, words, folder):
    """What the completion of --set offers in zsh, its compadd replaced by a function that prints."""
    given = " ".join(f"'{word}'" for word in words)
    program = (f"PATH='{folder}':$PATH; compadd() {{ shift 3; print -l -- $@ }}; words=({given}); CURRENT=$#words; "
               f"source <(sed '$d' '{script}'); _bromwich_parameters")
    return set(output("zsh", "-f", "-c", program).split())


def differences(what, expected, found):
    if expected - found:
        yield f"{what}: lacks {', '.join(sorted(expected - found))}"
    if found - expected:
        yield f"{what}: has {', '.join(sorted(found - expected))}, which the command does not take"


def faults(bromwich, pages):
    main = output(bromwich, "--help")
    commands = commands_of(main)
    script, zsh = pages / "bash" / "bromwich", (pages / "zsh" / "_bromwich").read_text(encoding="utf-8")
    manuals = sorted(path.name for path in (pages / "man1").glob("*"))
    yield from differences("bash, no command", {*commands, *options_of(main)}, completed(script, ["bromwich", ""]))
    for command in commands:
        options = options_of(output(bromwich, command, "--help"))
        yield from differences(f"bash, {command}", options, completed(script, ["bromwich", command, "-"]))
        yield from differences(f"zsh, {command}", options, in_zsh(zsh, command))
        if manuals:
            yield from differences(f"manual, {command}", options, in_manual(pages / "man1" / f"bromwich-{command}.1"))
        shown = (line.strip() for line in output(bromwich, command, "--help").splitlines())
        examples = [line for line in shown if line.startswith("bromwich ")]
        if manuals and shutil.which("man"):
            page = " ".join(output("env", "MANWIDTH=300", "man", "-l", pages / "man1" / f"bromwich-{command}.1").split(" ")).splitlines()
            yield from differences(f"lines of the manual, {command}", set(examples), {line.strip() for line in page} & set(examples))
    folder = str(Path(bromwich).resolve().parent)
    given = completed(script, ["bromwich", "solve", "signorini", "--set", ""], folder)
    yield from differences("bash, --set", {"Q=", "c=", "T="}, given)
    if sets := [command for command in commands if re.search(r"^  --set ", output(bromwich, command, "--help"), re.M)]:
        taking = {command for command in sets if ":key=value: _bromwich_parameters'" in zsh.split(f"\n    {command})\n")[1].split(";;\n")[0]}
        yield from differences("zsh, commands whose --set is completed", set(sets), taking)
    methods = re.search(r"--method NAME\s+(.*?); default", output(bromwich, "solve", "--help"))[1].split(", ")
    yield from differences("bash, --method", set(methods), completed(script, ["bromwich", "solve", "--method", ""]))
    if shutil.which("zsh"):
        done = subprocess.run(["zsh", "-n", pages / "zsh" / "_bromwich"], text=True, stderr=subprocess.PIPE)
        if done.returncode or done.stderr:
            yield f"zsh: {done.stderr}"
        given = parameters_in_zsh(pages / "zsh" / "_bromwich", ["solve", "signorini", "--set", ""], folder)
        yield from differences("zsh, --set", {"Q", "c", "T"}, given)
    if shutil.which("man"):
        for name in manuals:
            done = subprocess.run(["man", "--warnings", "-l", pages / "man1" / name], text=True, stdout=subprocess.DEVNULL,
                                  stderr=subprocess.PIPE)
            if done.returncode or done.stderr:
                yield f"man {name}: {done.stderr}"
    if shutil.which("help2man") and not manuals:
        yield "no manual pages, although help2man is installed"


def main():
    if not list(differences("x", {"a", "b"}, {"b", "c"})) or options_of("  -h,--help   text\n  --set k  -x") != {"-h", "--help", "--set"}:
        return "command_pages: a page that lacks an option was accepted"
    return "\n".join(faults(sys.argv[1], Path(sys.argv[2]))) or 0


if __name__ == "__main__":
    sys.exit(main())
