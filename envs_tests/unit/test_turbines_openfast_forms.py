"""A model of OpenFAST in any form that OpenFAST reads is the same turbine, bit for bit."""

import re
import tempfile
from dataclasses import replace
from pathlib import Path
from random import Random

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from openfast_model import RULE, Model, with_few_points

from wt_gym.simulation.contract import fingerprint
from wt_gym.turbines import load_turbine
from wt_gym.turbines.openfast import read_openfast

FREE = ("aero/ad.dat", "servo/sd.dat", "blade.dat", "aero/af*.dat", "aero/af*_coords.txt")
"""Files that OpenFAST frees of comments first (ProcessComFile of its library)."""
VALUE = re.compile(r"\s*(\"[^\"]*\"|\S+)\s+([A-Za-z]\w*(?:\(\d\))?)(\s+-.*|\s*)")
"""Value, keyword and description."""
COMMENTS = ("! NumBl 2", "# 1.0 AirDens", "% it's (\") a comment", "!", "", "  ")


@pytest.fixture(scope="module")
def small():
    return with_few_points(load_turbine("nrel_5mw"))


def read(path):
    """Digest of a turbine without its notes."""
    return fingerprint(replace(read_openfast(path), notes=()))


class Form:
    """Legal changes of lines and files, drawn from a source of random numbers."""

    def __init__(self, random):
        self.random = random

    def some(self, share=0.5):
        return self.random.random() < share

    def token(self, word):
        """A value in another form."""
        if word.strip("'\"").lower() in ("true", "false", "t", "f"):
            first = word.strip("'\"")[0]
            long = {"t": ("T", ".true.", "TRUE", "tRue"), "f": ("f", ".FALSE.", "false", "F")}[first.lower()]
            return self.random.choice(long)
        if word.lower() in ('"default"', "default"):
            return self.random.choice(("default", '"DEFAULT"', "'Default'"))
        if word.startswith('"') and self.some():
            return "'" + word[1:-1] + "'"
        if re.fullmatch(r"-?\d+\.\d+", word) and self.some():
            return word + self.random.choice(("E+00", "d0", "D+00", "e0", "+0"))
        if re.fullmatch(r"-?\d+\.\d+e[+-]\d+", word) and self.some():
            return word.replace("e", self.random.choice("EDdQ"))
        return word

    def key(self, key):
        return self.random.choice((key, key.upper(), key.lower(), key.swapcase()))

    def gap(self):
        return self.random.choice((" ", "\t", "   ", " \t "))

    def row(self, line, between=(" ", "\t", ", ", ",  ")):
        """A line of numbers of a table or a list, with or without a keyword."""
        words, out, k = line.split(), [], 0
        while k < len(words):
            same = next((n for n in range(k, len(words)) if words[n] != words[k]), len(words)) - k
            repeats = same > 1 and re.fullmatch(r"[-+.\de]+", words[k]) is not None and self.some()
            out.append(f"{same}*{words[k]}" if repeats else self.token(words[k]))
            k += same if repeats else 1
        tail = self.random.choice(("", ",", "  ", "\t and words behind"))
        return self.random.choice(("", "  ", "\t")) + self.random.choice(between).join(out) + tail

    def line(self, line, free):
        """A line in another form: value and keyword, or a row of numbers."""
        match = VALUE.fullmatch(line)
        if line.lstrip().startswith(("--", "==", "!", "@")) or line.startswith("TITLE"):
            return line
        if match is not None and match[2] not in ("Member",):
            value, key, rest = match.groups()
            value, key, rest = self.token(value), self.key(key), rest.replace(" ", self.gap(), 1)
            if free and "(" not in key and "AFN" not in key.upper() and self.some(0.3):
                value, key = key, value  # where OpenFAST looks at it, the keyword may be the first
            between = self.random.choice((" ", "\t", " , "))
            return f"{self.gap()}{value}{between}{key}{rest}"
        return self.row(line) if re.match(r"\s*[-+.\d]", line) else line

    def file(self, name, text):
        """Bytes of a file in another form."""
        free = any(Path(name).match(pattern) for pattern in FREE)
        discon = name == "DISCON.IN"
        out = []
        for i, line in enumerate(text.splitlines()):
            changed = self.discon(line) if discon else self.line(line, free) if i > 1 or "af" in name else line
            if (free or discon) and self.some(0.2):
                out.append(self.random.choice(COMMENTS))
            elif i > 2 and VALUE.fullmatch(line) and not line.startswith("--") and self.some(0.2):
                out.append("")  # OpenFAST looks for a value in the next line
            if free and self.some(0.2) and not line.startswith("@"):
                changed += self.random.choice((" ! comment", "# 2.0", "\t% 3"))
            out.append(changed)
        if discon:
            self.random.shuffle(out)
        coding = self.random.choice(("utf-8", "utf-8-sig", "latin-1"))
        if free or discon:
            out.insert(1, "! Größe in Meter")  # the mark of UTF-8 would make a line of a comment that is the first
        else:
            out[1] += " Größe\u00a0\u0085"
        return self.random.choice(("\n", "\r\n")).join(out).encode(coding)

    def discon(self, line):
        """A line of DISCON.IN: ROSCO takes its keyword behind the values, with or without an exclamation mark."""
        values, mark, rest = line.partition("!")
        if not values.strip():
            return line
        key, _, description = rest.strip().partition(" ")
        words = [self.token(word) for word in values.split()]
        return f"{self.gap().join(words)} {self.random.choice((mark, ''))} {self.key(key)} {description}"


def shuffled_columns(random, text, first):
    """The table with a column in its header and its columns in another order."""
    lines = text.splitlines()
    at = next(i for i, line in enumerate(lines) if first in line.split())
    order = list(range(len(lines[at].split())))
    random.shuffle(order)
    for i in range(at, len(lines)):
        words = lines[i].split()
        if len(words) == len(order):
            lines[i] = " ".join(words[k] for k in order)
    return "\n".join(lines) + "\n"


@given(seed=st.integers(0, 2**32), beamdyn=st.booleans())
@settings(max_examples=8, deadline=None, phases=[Phase.generate])
def test_any_legal_form_is_the_same_turbine(small, seed, beamdyn):
    random = Random(seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        model = Model(small, beamdyn=beamdyn)
        model.discon |= {"PerfFileName": '"perf.txt"', "PerfTableSize": "2 3"}
        (folder / "perf.txt").write_text("# Pitch\n0 1\n# TSR\n7 7.5 8\n\n# Cp\n.4 .3\n.45 .35\n.5 .4\n")
        path = model.write(folder)
        expected = read(path)
        form = Form(random)
        for file in folder.rglob("*"):
            if file.is_file() and file.name != "perf.txt":
                text = file.read_text()
                if file.name == "blade.dat" and "BlChord" in text:
                    text = shuffled_columns(random, text, "BlChord")
                file.write_bytes(form.file(file.relative_to(folder).as_posix(), text))
        (folder / "perf.txt").write_text(
            "a\nb\n\nangles [deg]\n0\t1\nlambda\n7 7.5D0, 8\nwinds\n10\n\n.4 .3\n.45 .35\n.5 .4\n"
        )
        assert read(path) == expected


def test_parts_of_an_airfoil_file_may_stand_in_another(small, tmp_path):
    path = Model(small).write(tmp_path)
    expected = read(path)
    file = tmp_path / "aero" / "af3.dat"
    lines = file.read_text().splitlines()
    at = next(i for i, line in enumerate(lines) if "NumAlf" in line)
    (tmp_path / "aero" / "polar.txt").write_text("\n".join(["# coefficients", *lines[at:]]))
    file.write_text("\n".join([*lines[:at], '@ 2-99 in "polar.txt" ! the polar']))
    assert read(path) == expected
    (tmp_path / "aero" / "polar.txt").write_text('\n@"polar.txt"')
    with pytest.raises(ValueError, match="levels deep"):
        read_openfast(path)


def test_a_blade_of_two_members_is_that_of_one(small, tmp_path):
    """Members share the key point where they meet."""
    path = Model(small, beamdyn=True).write(tmp_path)
    expected = read(path)
    file = tmp_path / "bd.dat"
    text, n = file.read_text(), small.blade.aero_station.size
    assert "1   member_total" in text
    for wrong in (0, 1):
        two = re.sub(r"1   member_total", "2   member_total", text)
        two = re.sub(rf"1 {n} - .*\n", f"1 5 - Member\n2 {n - 4 + wrong} - Member\n", two)
        file.write_text(two)
        if wrong:
            with pytest.raises(ValueError, match="kp_total"):
                read_openfast(path)
        else:
            assert read(path) == expected


@pytest.mark.parametrize("heading", ["---- DISTRIBUTED PROPERTIES", "==== Sections", "-- distributed props --"])
def test_the_sections_of_beamdyn_stand_below_the_last_heading(small, heading, tmp_path):
    path = Model(small, beamdyn=True).write(tmp_path)
    expected = read(path)
    file = tmp_path / "bd_sections.dat"
    head, _, sections = file.read_text().partition("---------------------- DISTRIBUTED PROPERTIES")
    text = re.sub(r"\n\n", "\nmatrix\n", sections.partition("\n")[2])  # any text stands where a line is empty
    file.write_text(f"{head}{heading}\n{text}")
    assert read(path) == expected


@pytest.mark.parametrize("beamdyn", [False, True])
def test_copies_of_a_blade_file_are_one_blade(small, beamdyn, tmp_path):
    model = Model(small, beamdyn=beamdyn)
    expected = read(model.write(tmp_path))
    owner, key, name = (model.primary, "BDBldFile({})", "bd") if beamdyn else (model.elastodyn, "BldFile{}", "blade")
    for i in (1, 2, 3):
        owner[key.format(i)] = f'"{name}{i}.dat"'
    path = model.write(tmp_path)
    text = (tmp_path / f"{name}.dat").read_text()
    for i in (1, 2, 3):
        (tmp_path / f"{name}{i}.dat").write_text(
            f"title {i}\n{text.partition(chr(10))[2]}".replace("bd_sec", f"bd{i}_sec")
        )
        (tmp_path / f"bd{i}_sections.dat").write_text((tmp_path / "bd_sections.dat").read_text())
    assert read(path) == expected
    other = tmp_path / ("bd3_sections.dat" if beamdyn else "blade3.dat")
    other.write_text(other.read_text().replace("0.000000000000e+00", "1.000000000000e-03", 1))
    with pytest.raises(ValueError, match="the same file for all blades, or copies of it"):
        read_openfast(path)


def test_lines_that_contradict_each_other_are_refused(small, tmp_path):
    path = Model(small).write(tmp_path)
    file = tmp_path / "ed.dat"
    file.write_text(file.read_text() + f"{RULE}\n 40.0   HubMass - again\n")
    with pytest.raises(ValueError, match=r"HubMass must be one value"):
        read_openfast(path)
