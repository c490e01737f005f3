"""What testing machines, nanoindenters and laboratories call travel, force and time, in small letters."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

NAMES: Mapping[str, frozenset[str]] = MappingProxyType(
    {
        "depth": frozenset(
            {"indentation", "indentation depth", "penetration", "penetration depth", "indenter displacement",
             "indenter position", "indenter travel", "displacement", "displ", "disp", "distance", "extension",
             "travel", "stroke", "position", "deformation", "compression", "crosshead", "crosshead displacement",
             "crosshead position", "crosshead travel", "actuator displacement", "actuator position",
             "axial displacement", "axial position", "compressive displacement", "compressive extension",
             "z displacement", "displacement z", "z position", "position z", "position (z)", "indent depth",
             "displacement into surface", "ram displacement", "platen displacement", "tip displacement",
             "tip position", "vertical tip position", "verticaltipposition", "tip sample separation",
             "tipsampleseparation", "separation", "pd", "weg", "standardweg", "traversenweg", "maschinenweg",
             "kolbenweg", "prüfweg", "verformung", "verfahrweg", "eindringtiefe", "eindringweg", "eindringung",
             "position traverse", "déplacement", "déplacement traverse", "enfoncement", "profondeur", "pénétration",
             "profondeur de pénétration", "profondeur d'indentation", "allongement", "course", "course standard",
             "desplazamiento", "profundidad", "penetración", "posición", "spostamento", "profondità", "penetrazione",
             "corsa", "deslocamento", "profundidade", "penetração", "verplaatsing", "indringdiepte", "förskjutning",
             "forskydning", "djup", "przemieszczenie", "głębokość", "posunutí", "dráha", "hloubka", "siirtymä",
             "перемещение", "глубина", "位移", "深度", "压入深度", "行程", "変位", "押込み深さ", "押し込み深さ",
             "ストローク", "변위", "deplasman", "yer değiştirme"}
        ),
        "Fz": frozenset(
            {"force", "force z", "z force", "load", "normal force", "normal load", "axial force",
             "axial load", "compressive force", "compressive load", "vertical force", "indentation force", "load cell",
             "force a", "load on sample", "applied load", "applied force", "kraft", "standardkraft", "prüfkraft",
             "normalkraft", "druckkraft", "force standard", "force normale", "fn", "charge", "effort", "fuerza",
             "fuerza normal", "carga", "forza", "forza normale", "carico", "força", "kracht", "siła", "síla", "voima",
             "сила", "нагрузка", "力", "载荷", "负荷", "试验力", "荷重", "試験力", "하중", "kuvvet", "yük"}
        ),
        "time": frozenset(
            {"time", "timestamp", "elapsed time", "test time", "total time", "running time", "time on sample",
             "series time", "seriestime", "segment time", "zeit", "prüfzeit", "testzeit", "laufzeit", "temps",
             "temps d'essai", "temps d’essai", "temps écoulé", "tiempo", "tempo", "tijd", "tid", "czas", "čas", "aika",
             "время", "时间", "時間", "시간", "zaman"}
        ),
    }
)  # fmt: skip
# Of one letter, or of what is a length or a voltage elsewhere: names only with a unit of the right kind.
UNITED: Mapping[str, frozenset[str]] = MappingProxyType(
    {"depth": frozenset({"h", "z", "d", "u", "s", "δ"}),
     "Fz": frozenset({"p", "f", "vdeflection", "vertical deflection", "deflection"}),
     "time": frozenset({"t"})}
)  # fmt: skip
# Words beside a name that make it no other thing.
QUALIFIERS = frozenset(
    "corrected measured actual filtered calibrated compensated net tared absolute relative mean average avg value "
    "sample specimen indenter probe stage sensor cell channel corr total korrigierte korrigierter korr gemessene "
    "corrigée corrigé mesurée mesuré".split()
)
SEGMENT = frozenset(
    {"segmentid", "segment id", "segment", "segment no", "segment nr", "segment number", "segment type",
     "segmenttype", "seg", "phase", "step", "schritt", "abschnitt", "prüfschritt"}
)  # fmt: skip
WORDS: Mapping[str, str] = MappingProxyType(
    dict.fromkeys(("loading", "load", "extend", "approach", "ramp up", "belasten", "belastung", "charge"), "loading")
    | dict.fromkeys(("hold", "holding", "pause", "dwell", "halten", "maintien"), "hold")
    | dict.fromkeys(("unloading", "unload", "retract", "withdraw", "entlasten", "entlastung", "décharge"), "unloading")
)
TENSILE = ("tensile", "tension test", "zugversuch", "zugkraft", "zugprüfung", "essai de traction", "ensayo de tracción",
           "prova di trazione", "ultimate strength", "elongation at break", "bruchdehnung")  # fmt: skip
