"""A plant as a MATLAB or Octave function `<name>.m` that loads `<name>.mat` and returns a model with names.

sys = plant()            % ss, or dss for a descriptor plant
sys = plant("mechss")    % modal plants, MATLAB: mechss(M, C, K, B, F, G, D)
"""

from __future__ import annotations

from pathlib import Path

from flexplant.io.formats import Writer
from flexplant.io.parse.own_plant import Plant
from flexplant.io.write.atomic import replacing
from flexplant.io.write.c_text import comment, matlab_name
from flexplant.io.write.mat import NAME as DATA
from flexplant.io.write.mat import write_plant as write_mat
from flexplant.io.write.ownership import mark, written_as

NAME = "matlab_script"
SCRIPT = """\
function [sys, p] = {name}(form)
% {title}. {mark}; the numbers are in {name}.mat, which belongs beside this file.
% sys = {name}()          ss; dss where the plant is a descriptor; channels by name
% sys = {name}("mechss")  second-order model of a modal plant (MATLAB R2020b or later)
% [sys, p] = {name}()     p: the matrices themselves
if nargin < 1, form = ""; end
p = load(fullfile(fileparts(mfilename("fullpath")), "{name}.mat"));
names = {{"InputName", p.InputName, "OutputName", p.OutputName}};
if strcmp(form, "mechss")
  m = p.mechanical;
  sys = mechss(m.M, m.C, m.K, m.B, m.F, m.G, m.D, names{{:}});
elseif isfield(p, "E")
  sys = dss(full(p.A), full(p.B), full(p.C), full(p.D), full(p.E), names{{:}});
elseif p.dt > 0
  sys = ss(p.A, p.B, p.C, p.D, p.dt, names{{:}});
else
  sys = ss(p.A, p.B, p.C, p.D, names{{:}});
end
if ~exist("OCTAVE_VERSION", "builtin")
  set(sys, "InputUnit", p.InputUnit, "OutputUnit", p.OutputUnit, "Name", p.Name);
end
end
"""


def write_plant(plant: Plant, path: Path, *, target: Path) -> None:
    """The function at `path`, its data beside `target`; InputError where the file's stem is no MATLAB name."""
    name = matlab_name(target.stem)
    with replacing(_data(target)) as work:
        write_mat(plant, work)
    path.write_text(SCRIPT.format(name=name, title=comment(plant.name), mark=mark(NAME)), encoding="utf-8")


def _data(target: Path) -> Path:
    return target.with_suffix(".mat")


def _written_as(path: Path) -> str:
    """As `written_as`: the script loads any plant of ours, so a plant that stands there as `.mat` is the script's as well."""
    found = written_as(path)
    return NAME if found == DATA else found


WRITER = Writer(
    name=NAME,
    description="MATLAB/Octave function that returns ss, dss or mechss with names, and its .mat",
    suffixes=(".m",),
    tested_against="Octave 7 with control",
    beside=lambda target: (_data(target),),
    written_as=_written_as,
    writers={"write_plant": write_plant},
)
