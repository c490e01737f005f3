"""Material cards and input files for other programs, read again by readers of this file."""

import math
import re
import shutil
import subprocess
from xml.etree import ElementTree

import numpy as np
import pytest

from fem_backend.backend import BACKEND
from fem_backend.export import material_cards as mc
from fem_backend.laws import Material, Prony
from fem_backend.laws.linear_elastic import LinearElastic
from fem_backend.laws.mooney_rivlin import MooneyRivlin
from fem_backend.laws.neo_hooke import NeoHooke
from fem_backend.laws.ogden import Ogden
from fem_backend.laws.yeoh import Yeoh
from rso.contract import Case, Programme

SLAB = {
    "specimen": {"shape": "slab", "thickness": 6.0},
    "indenter": {"shape": "sphere", "radius": 3.0},
    "support": {"kind": "bonded"},
    "mesh": {"level": "coarse"},
}
VALUES = {"mu": 0.01, "D1": 20.0}
CASE = Case("top", Programme.ramp((0.5, 1.0), 0.5), SLAB)
LAWS = {
    "neo-Hooke": NeoHooke(0.012, 9.0),
    "Yeoh": Yeoh(0.012, 9.0, 3e-4, 5e-5),
    "Mooney-Rivlin": MooneyRivlin(0.012, 9.0, 2e-3),
    "Ogden": Ogden(0.012, 9.0, (3.5, -2.0), (0.7, 0.3)),
}
STRETCHES = [(1.3, 0.9, 0.9), (0.6, 1.2, 1.2), (0.9, 0.9, 0.9), (1.1, 1.1, 1.1), (1.4, 0.8, 1.05)]


def numbers(lines):
    return [float(v) for line in lines for v in line.split(",") if v.strip()]


def invariants(stretch):
    """Ī₁, Ī₂, J of principal stretches, and the isochoric ones."""
    a = np.array(stretch)
    J = float(a.prod())
    bar = a * J ** (-1.0 / 3.0)
    return float((bar**2).sum()), float((bar**-2.0).sum()), J, bar


def by_abaqus(lines, stretch):
    """U by the Abaqus guide and the CalculiX manual from the lines of a card."""
    i1, i2, J, bar = invariants(stretch)
    words = [w.strip() for w in lines[1].split(",")]
    v = numbers(lines[2:])
    if "OGDEN" in words:
        n = int(re.search(r"N=(\d)", lines[1])[1])
        terms = [(v[2 * k], v[2 * k + 1]) for k in range(n)]
        return sum(2 * m / a**2 * ((bar**a).sum() - 3) for m, a in terms) + (J - 1) ** 2 / v[2 * n]
    if "YEOH" in words:
        return sum(c * (i1 - 3) ** k for k, c in enumerate(v[:3], 1)) + (J - 1) ** 2 / v[3]
    if "MOONEY-RIVLIN" in words:
        return v[0] * (i1 - 3) + v[1] * (i2 - 3) + (J - 1) ** 2 / v[2]
    assert "NEO HOOKE" in words
    return v[0] * (i1 - 3) + (J - 1) ** 2 / v[1]


def by_ansys(lines, stretch):
    """W by the ANSYS Material Reference from the commands of a card."""
    i1, i2, J, bar = invariants(stretch)
    table = next(line for line in lines if line.startswith("TB,HYPER"))
    v = [float(w) for line in lines if line.startswith("TBDATA") for w in line.split(",")[2:]]
    kind = table.split(",")[-1]
    if kind == "OGDEN":
        n = int(table.split(",")[4])
        terms = [(v[2 * k], v[2 * k + 1]) for k in range(n)]
        return sum(m / a * ((bar**a).sum() - 3) for m, a in terms) + (J - 1) ** 2 / v[2 * n]
    if kind == "YEOH":
        return sum(c * (i1 - 3) ** k for k, c in enumerate(v[:3], 1)) + (J - 1) ** 2 / v[3]
    if kind == "MOONEY":
        return v[0] * (i1 - 3) + v[1] * (i2 - 3) + (J - 1) ** 2 / v[2]
    assert kind == "NEO"
    return v[0] / 2 * (i1 - 3) + (J - 1) ** 2 / v[1]


def by_febio(lines, stretch):
    """W by FEBio's source (FEMooneyRivlin, FEYeoh, FEOgdenMaterial; U with pressure_model 2) from an element."""
    i1, i2, J, bar = invariants(stretch)
    element = ElementTree.fromstring("\n".join(lines))
    v = {child.tag: float(child.text) for child in element}
    assert v["pressure_model"] == 2
    volume = 0.5 * v["k"] * (J - 1) ** 2
    if element.get("type") == "Ogden":
        terms = [(v[f"c{k}"], v[f"m{k}"]) for k in range(1, 7) if f"c{k}" in v]
        return sum(c / m**2 * ((bar**m).sum() - 3) for c, m in terms) + volume
    if element.get("type") == "Yeoh":
        return sum(v[f"c{k}"] * (i1 - 3) ** k for k in (1, 2, 3)) + volume
    assert element.get("type") == "Mooney-Rivlin"
    return v["c1"] * (i1 - 3) + v["c2"] * (i2 - 3) + volume


def own(law, stretch):
    i1, i2, J, bar = invariants(stretch)
    if isinstance(law, Ogden):
        mu, alpha = law.terms
        return sum(2 * m / a**2 * ((bar**a).sum() - 3) for m, a in zip(mu, alpha, strict=True)) + (J - 1) ** 2 / law.D1
    return float(law.energy(*(np.array([v]) for v in (i1, i2, J)))[0])


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("program", ["abaqus", "ansys", "febio"])
def test_the_energy_of_a_card_is_that_of_the_law(name, program):
    law = LAWS[name]
    c = mc.card_constants(Material(law))
    lines = {"abaqus": mc.abaqus, "ansys": mc.ansys, "febio": mc.febio_card}[program](c)
    read = {"abaqus": by_abaqus, "ansys": by_ansys, "febio": by_febio}[program]
    for stretch in STRETCHES:
        assert read(lines, stretch) == pytest.approx(own(law, stretch), rel=1e-10)
    if name == "neo-Hooke":  # a small wrong constant would be seen
        other = mc.card_constants(Material(NeoHooke(0.012, 9.01)))
        off = {"abaqus": mc.abaqus, "ansys": mc.ansys, "febio": mc.febio_card}[program](other)
        assert abs(read(off, (0.9, 0.9, 0.9)) / own(law, (0.9, 0.9, 0.9)) - 1) > 1e-4


def test_sofa_has_another_energy_that_agrees_for_small_strains():
    """SOFA's W = mu/2 (I1 − 3) − mu ln J + lambda/2 ln² J: its second derivatives at rest are those of the law."""
    law = LAWS["neo-Hooke"]
    lines = mc.sofa(mc.card_constants(Material(law)))
    mu, lam = map(float, re.search(r'ParameterSet="(\S+) (\S+)"', lines[-1]).groups())

    def theirs(stretch):
        a = np.array(stretch)
        J = a.prod()
        return mu / 2 * ((a**2).sum() - 3) - mu * np.log(J) + lam / 2 * np.log(J) ** 2

    for way in ((1.0, 0.0, 0.0), (1.0, 1.0, 1.0), (1.0, -0.5, -0.5)):
        ratio = [theirs(1 + e * np.array(way)) / own(law, 1 + e * np.array(way)) for e in (1e-2, 1e-3)]
        assert abs(ratio[1] - 1) < 0.02 and abs(ratio[1] - 1) < 0.2 * abs(ratio[0] - 1) + 1e-4
    assert any("not the law that was fitted" in line for line in lines)


def test_relaxation_is_written_from_the_instantaneous_moduli_or_said_to_be_missing():
    stuff = Material(LAWS["neo-Hooke"], prony=Prony((0.3, 0.1), (0.5, 10.0)))
    c = mc.card_constants(stuff)
    lines = mc.abaqus(c)
    assert "MODULI=INSTANTANEOUS" in lines[1] and lines[-2:] == ["0.3, 0, 0.5", "0.1, 0, 10"]
    assert mc.ansys(c)[-2:] == ["TB,PRONY,MAT_ID,1,2,SHEAR", "TBDATA,1,0.3,0.5,0.1,10"]
    written = mc.cards(c, ["mu = 1"])
    for file in ("material_calculix.inp", "material_febio.xml", "material_sofa.py"):
        assert "not written: " in written[file] and "HYPERELASTIC" not in written[file]


def test_small_strains_are_e_and_nu():
    c = mc.card_constants(Material(LinearElastic(0.012, 9.0)))
    E, nu = numbers(mc.abaqus(c)[2:])
    assert E / (2 * (1 + nu)) == pytest.approx(0.012, rel=1e-10) and E / (3 * (1 - 2 * nu)) == pytest.approx(2 / 9.0)


def test_cards_hold_values_and_intervals_as_comments():
    text = BACKEND.exported("cards", VALUES, CASE, ["mu = 0.01 MPa, 90 % interval 0.009 to 0.011 MPa: determined"])
    assert set(text) == {card.file for card in mc.CARDS.values()}
    for name, found in text.items():
        assert "interval 0.009 to 0.011" in found, name
    ElementTree.fromstring(f"<r>{text['material_febio.xml']}</r>")


# ----------------------------------------------------------------------------------------------------- input files


@pytest.fixture(scope="module")
def feb():
    return ElementTree.fromstring(BACKEND.exported("febio", VALUES, CASE, ["a -- b"])["indentation.feb"])


@pytest.fixture(scope="module")
def inp():
    return BACKEND.exported("abaqus", VALUES, CASE, [])["indentation.inp"]


def of_feb(feb):
    X = np.array([[float(v) for v in n.text.split(",")] for n in feb.find("Mesh/Nodes")])
    parts = {e.get("name"): np.array([[int(k) for k in c.text.split(",")] for c in e]) for e in feb.iter("Elements")}
    sets = {s.get("name"): [int(k) for k in s.text.split(",")] for s in feb.iter("NodeSet")}
    surfaces = {s.get("name"): [[int(k) for k in f.text.split(",")] for f in s] for s in feb.iter("Surface")}
    return X, parts, sets, surfaces


def of_inp(text):
    """Blocks of keyword lines: (keyword with its options, data lines)."""
    blocks = []
    for line in text.splitlines():
        if line.startswith("**"):
            continue
        if line.startswith("*"):
            blocks.append((line.upper(), []))
        else:
            blocks[-1][1].append(line)
    return blocks


def volume(X, cells):
    a, b, c, d = (X[cells[:, k] - 1] for k in range(4))
    return np.einsum("ci,ci->c", np.cross(b - a, c - a), d - a) / 6.0


def test_the_mesh_is_right_way_round_and_the_same_in_both_files(feb, inp):
    X, parts, _, _ = of_feb(feb)
    cells = parts["Specimen1"]
    V = volume(X, cells)
    assert np.all(V > 0)
    quarter = X[np.unique(cells) - 1]
    assert V.sum() == pytest.approx(math.pi / 4 * quarter[:, 0].max() ** 2 * 6.0, rel=0.02) or V.sum() == pytest.approx(
        np.ptp(quarter[:, 0]) * np.ptp(quarter[:, 1]) * 6.0, rel=1e-6
    )
    blocks = of_inp(inp)
    Y = np.array([numbers([row])[1:] for row in next(d for k, d in blocks if k.startswith("*NODE, NSET=ALL"))])
    other = [numbers([row]) for k, d in blocks if "TYPE=C3D10" in k for row in d]
    np.testing.assert_array_equal(np.array(other, int)[:, 1:], cells)
    np.testing.assert_allclose(Y[: len(quarter)], X[: len(quarter)], rtol=1e-11, atol=1e-11)
    # middle nodes belong to the edges that both manuals say: 5..10 of corners 12, 23, 31, 14, 24, 34
    straight = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
    for k, (i, j) in enumerate(straight):
        gap = np.linalg.norm(X[cells[:, 4 + k] - 1] - 0.5 * (X[cells[:, i] - 1] + X[cells[:, j] - 1]), axis=1)
        length = np.linalg.norm(X[cells[:, i] - 1] - X[cells[:, j] - 1], axis=1)
        assert np.all(gap < 0.1 * length)  # of a curved boundary


def test_sets_hold_what_is_held(feb):
    X, parts, sets, _ = of_feb(feb)
    fixes = {bc.get("node_set"): [int(bc.find(f"{a}_dof").text) for a in "xyz"] for bc in feb.find("Boundary")}
    held = {k: np.zeros(3, bool) for k in np.unique(parts["Specimen1"])}
    for name, kind in fixes.items():
        for node in sets[name]:
            assert not held[node].any()  # each node in one set
            held[node] = np.array(kind, bool)
    for node, kind in held.items():
        x, y, z = X[node - 1]
        assert kind[2] == (abs(z) < 1e-9)  # the bonded base
        assert kind[0] == (x == 0.0 or kind[2]) and kind[1] == (y == 0.0 or kind[2])
    record = feb.find("Output/logfile/rigid_body_data")  # nodes that are fixed have no reactions in FEBio
    material = next(m for m in feb.find("Material") if m.get("type") == "rigid body")
    assert record.text == material.get("id") and "Fz" in record.get("data").split(";")


def test_surfaces_turn_outward_and_the_ball_touches_the_top(feb, inp):
    X, _, _, surfaces = of_feb(feb)
    top = np.array(surfaces["Top"])
    a, b, c = (X[top[:, k] - 1] for k in range(3))
    assert np.all(np.cross(b - a, c - a)[:, 2] > 0) and np.allclose(X[top - 1][:, :, 2], 6.0)
    centre = np.array([0.0, 0.0, 6.0 + 3.0])
    for face in surfaces["Tool"]:
        p = X[np.array(face) - 1]
        np.testing.assert_allclose(np.linalg.norm(p - centre, axis=1), 3.0, rtol=1e-9)
        normal = np.cross(p[1] - p[0], p[2] - p[0])
        assert normal @ (p.mean(0) - centre) > 0
    lowest = X[np.unique(np.concatenate(surfaces["Tool"])) - 1][:, 2].min()
    assert lowest == pytest.approx(6.0, abs=1e-9)
    # the faces S1 to S4 of Abaqus are those of the same facets
    blocks = of_inp(inp)
    cells = {
        int(r[0]): [int(v) for v in r[1:]]
        for k, d in blocks
        if "TYPE=C3D10" in k
        for r in map(numbers, ([x] for x in d))
    }
    sides = {"S1": (0, 1, 2), "S2": (0, 3, 1), "S3": (1, 3, 2), "S4": (2, 3, 0)}
    rows = next(d for k, d in blocks if k.startswith("*SURFACE, NAME=TOP"))
    named = {frozenset(cells[int(e)][k] for k in sides[s.strip()]) for e, s in (r.split(",") for r in rows)}
    assert named == {frozenset(f[:3]) for f in surfaces["Top"]}


def test_the_load_follows_the_programme_and_forces_are_those_of_a_quarter(feb, inp):
    curves = {
        c.get("id"): [tuple(map(float, p.text.split(","))) for p in c.find("points")] for c in feb.find("LoadData")
    }
    press = next(b for b in feb.find("Rigid") if b.get("type") == "rigid_displacement")
    depth = float(press.find("value").text)
    assert (press.find("dof").text, depth) == ("z", -1.0) and curves["1"] == [(0.0, 0.0), (2.0, 1.0)]
    assert [t for t, _ in curves["2"]] == [0.0, 1.0, 2.0]  # must points: 0.5 and 1 mm at 0.5 mm/s
    steps = [d for k, d in of_inp(inp) if k.startswith("*BOUNDARY")][1:]
    assert [numbers([d[2].split(",", 1)[1]])[-1] for d in steps] == [-0.5, -1.0]
    assert "multiply forces by 4" in inp
    k = {m.get("name"): m for m in feb.find("Material")}["SPECIMEN1"]
    assert float(k.find("c1").text) == 0.005 and float(k.find("k").text) == pytest.approx(0.1)


@pytest.mark.parametrize(("more", "values", "words"), [
    ({}, {"weight": 1e-5}, "weight = 1e-05"),
    ({}, {"adhesion": 1e-3}, "adhesion = 0.001"),
    ({}, {"skin_ratio": 2.0}, "skin_ratio = 2"),
    ({"support": {"kind": "plate", "friction": 0.3}}, {}, "only held ones are written"),
    ({}, {"fibre": 0.01}, "fibre = 0.01"),
])  # fmt: skip
def test_what_a_deck_cannot_say_is_refused(more, values, words):
    case = Case("top", CASE.programme, {**SLAB, **more})
    with pytest.raises(ValueError, match=re.escape(words)):
        BACKEND.exported("febio", {**VALUES, **values}, case, [])


def test_layers_are_materials_of_their_own():
    settings = {**SLAB, "specimen": {"shape": "slab", "thickness": 6.0, "layers": [{"thickness": 2.0, "ratio": 3.0}]}}
    text = BACKEND.exported("febio", VALUES, Case("top", CASE.programme, settings), [])["indentation.feb"]
    root = ElementTree.fromstring(text)
    found = {m.get("name"): float(m.find("c1").text) for m in root.find("Material") if m.find("c1") is not None}
    assert sorted(found.values()) == pytest.approx([0.005, 0.015])
    X, parts, _, _ = of_feb(root)
    stiff = next(k for k, v in found.items() if v > 0.01)[-1]
    assert X[parts[f"Specimen{stiff}"][:, :4] - 1].mean(1)[:, 2].min() > 4.0


@pytest.mark.skipif(shutil.which("ccx") is None, reason="needs ccx (apt-get install calculix-ccx)")
@pytest.mark.verification
def test_calculix_finds_the_same_forces(inp, tmp_path):
    """Of another code on the coarse mesh in three dimensions, against the meridian's: within 2 %."""
    (tmp_path / "a.inp").write_text(inp)
    subprocess.run(["ccx", "-i", "a"], cwd=tmp_path, check=True, timeout=600, capture_output=True)
    blocks = re.findall(r"total force.*time\s+(\S+)\s+\S+\s+\S+\s+(\S+)", (tmp_path / "a.dat").read_text())
    found = {round(float(t), 6): -4.0 * float(f) for t, f in blocks}
    expected = BACKEND(VALUES, CASE).channels["Fz"]
    assert [found[1.0], found[2.0]] == pytest.approx(list(expected), rel=0.02)
