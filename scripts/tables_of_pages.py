"""Which tables stand on which page of README.md and docs/, and which are its appendix: that is made where the book is built
(docs/conf.py) and is not in the repository."""
import re
import sys

import evidence
import tables_chunks as chunks
import tables_circuits as circuits
import tables_contacts as contacts
import tables_gpu as device
import tables_speed as speed
import tables_studies as studies
import tables_trust as worth
from tables_device import headline_device, speed_vs_error_device
from tables_dual import dual, dual_times, headline_dual, puts
from tables_galerkin import galerkin
from tables_goal import adjoints, goal, goal_peers
from tables_micro import micro
from tables_paper import paper, times
from tables_papers import (
    case_one,
    galerkin_claims,
    goal_claims,
    laplace,
    literal_places,
    multirate,
    nonlinear,
    nonlinear_device,
)
from tables_peers import headline as peers_headline
from tables_peers import peers
from tables_python import python


def short(make, tables=0, notes=("",)):
    """The first tables that `make` writes, its notes that begin so, and where they come from: the rest is for the appendix."""

    def lines_of(data):
        lines, kept, seen = make(data), [], 0
        for before, line in zip([""] + lines, lines):
            is_row = line.startswith("|")
            seen += is_row and not before.startswith("|")
            if is_row and seen <= tables:
                kept.append(line)
        said = [line for line in lines if line.startswith(tuple("- " + note for note in notes))]
        return kept + [""] * bool(kept and said) + said + ["", f"{data['machine']['cpu']}, {evidence.origin(data)}."]

    return lines_of


# {file: {block: (measurements, lines of markdown)}}
blocks = {
    "README.md": {
        "headline": ("speed-vs-error", speed.headline),
        "headline-gpu": ("gpu", speed.headline_gpu),
        "headline-device": ("speed-vs-error-gpu", headline_device),
        "headline-dual": ("dual-times-gpu", headline_dual),
        "headline-peers": ("peers", peers_headline),
    },
    "docs/measurements/speed-vs-error.md": {
        "lost": ("speed-vs-error", speed.lost),
        "equal-steps": ("baselines", short(studies.baselines)),
    },
    "docs/measurements/multigrid.md": {"multigrid-short": ("multigrid", short(studies.multigrid, notes=("contraction", "at most")))},
    "docs/measurements/tol.md": {"tol-short": ("tol", worth.tol_share)},
    "docs/measurements/siconos.md": {"peers-short": ("peers", short(peers))},
    "docs/measurements/ngspice.md": {
        "circuits-counts": ("circuits", circuits.counts),
        "circuits-lost": ("circuits", circuits.lost),
        "circuits-failures": ("circuits", circuits.failures),
    },
    "docs/netlists.md": {"operating-map": ("map", circuits.operating_map)},
    "docs/mechanics.md": {
        "contacts-errors": ("contacts", contacts.errors),
        "contacts-chains": ("contacts", contacts.chains),
        "contact-structures": ("contact-structures", contacts.structures),
        "gears": ("gears", contacts.gears),
        "responses": ("response", contacts.responses),
    },
    "docs/lcp.md": {"cones": ("friction", contacts.cones)},
    "docs/measurements/micro.md": {"micro-short": ("micro", short(micro))},
    "docs/dual.md": {
        "dual-short": ("dual-gpu", short(dual, notes=("contraction", "algebraic"))),
        "dual-times": ("dual-times-gpu", dual_times),
        "dual-puts": ("dual", puts),
    },
    "docs/chunks.md": {"chunks-random": ("chunks", chunks.random)},
    "docs/derivatives.md": {"fit": ("fit", studies.fit)},
    "docs/batches.md": {"batch": ("batch", studies.batches)},
    "docs/fields.md": {
        "bracket": ("bracket", studies.bracket),
        "fields-short": ("fields", short(studies.fields)),
        "sparse": ("sparse", studies.sparse),
    },
    "docs/slabs.md": {"scale": ("scale", studies.scale)},
    "docs/nonlinear.md": {"nonlinear-short": ("nonlinear", short(nonlinear, tables=1, notes=("`",)))},
    "docs/papers/laplace.md": {
        "papers-laplace": ("paper", laplace),
        "papers-times": ("paper", times),
    },
    "docs/papers/galerkin.md": {"papers-galerkin": ("galerkin", galerkin_claims)},
    "docs/papers/goal.md": {"papers-goal": ("goal", goal_claims)},
    "docs/engineering.md": {"coverage": ("coverage", worth.coverage)},
    "docs/python.md": {"python": ("python", python)},
    "docs/scenes.md": {"scenes": ("scenes", studies.scenes)},
    "docs/stability.md": {
        "random": ("random", worth.random),
        "trust": ("trust", worth.trust),
        "engineering": ("engineering", worth.engineering),
    },
}

appendices = {
    "docs/measurements/speed-vs-error.md": {
        "speed-vs-error": ("speed-vs-error", speed.speed_vs_error),
        "not-solved": ("speed-vs-error", speed.not_solved),
        "speed-vs-error-gpu": ("speed-vs-error-gpu", speed_vs_error_device),
        "baselines": ("baselines", studies.baselines),
    },
    "docs/measurements/prepared.md": {
        "solver": ("solver", studies.solver),
        "solver-gpu": ("solver-gpu", studies.solver),
        "gpu-again": ("gpu-again", device.gpu_again),
    },
    "docs/measurements/multigrid.md": {
        "multigrid": ("multigrid", studies.multigrid),
        "multigrid-cpu": ("multigrid-cpu", studies.multigrid),
    },
    "docs/measurements/auto.md": {
        "auto": ("auto", studies.auto_choices),
        "auto-cpu": ("auto-cpu", studies.auto_choices),
    },
    "docs/measurements/tol.md": {"tol": ("tol", worth.tol)},
    "docs/measurements/siconos.md": {"peers": ("peers", peers)},
    "docs/measurements/ngspice.md": {"circuits": ("circuits", circuits.all_circuits)},
    "docs/measurements/micro.md": {"micro": ("micro", micro), "convolution": ("convolution", studies.convolution)},
    "docs/measurements/gpu.md": {"gpu": ("gpu", device.gpu)},
    "docs/lcp.md": {"lcp-gpu": ("lcp-gpu", device.lcp)},
    "docs/dual.md": {"dual-gpu": ("dual-gpu", dual), "dual-cpu": ("dual", dual)},
    "docs/chunks.md": {"chunks-scenes": ("chunks", chunks.scenes), "chunks-gpu": ("chunks-gpu", chunks.times)},
    "docs/derivatives.md": {
        "derivative-costs": ("batch", studies.derivative_costs),
        "derivatives": ("derivatives", studies.derivatives),
    },
    "docs/batches.md": {
        "batches": ("batches", studies.whole_batches),
        "batches-gpu": ("batches-gpu", studies.whole_batches),
        "streams-gpu": ("streams-gpu", studies.streams),
    },
    "docs/three-dimensions.md": {
        "signorini3d-gpu": ("signorini3d-gpu", studies.signorini3d),
        "kernels-gpu": ("kernels-gpu", studies.kernels),
    },
    "docs/fields.md": {
        "fields": ("fields", studies.fields),
        "fields-million": ("fields-million", studies.fields),
        "fields-peers": ("fields-peers", studies.fields_peers),
    },
    "docs/slabs.md": {"scale-gpu": ("scale-gpu", studies.scale_gpu), "timeline": ("timeline-gpu", studies.timeline)},
    "docs/nonlinear.md": {"nonlinear": ("nonlinear", nonlinear), "nonlinear-gpu": ("nonlinear-gpu", nonlinear_device)},
    "docs/papers/laplace.md": {
        "paper": ("paper", paper),
        "papers-case-one": ("paper", case_one),
        "papers-literal": ("literal-gpu", literal_places),
    },
    "docs/papers/galerkin.md": {"galerkin": ("galerkin", galerkin)},
    "docs/papers/goal.md": {
        "goal": ("goal", goal),
        "goal-peers": ("goal-peers", goal_peers),
        "adjoints": ("adjoints", adjoints),
        "papers-multirate": ("multirate", multirate),
    },
    "docs/scenes.md": {"scenes-full": ("scenes", studies.scenes_full)},
    "docs/stability.md": {
        "stability": ("stability", worth.stability),
        "trust-steps": ("trust-steps", worth.given_steps),
    },
}


def made(entry):
    measurements, make = entry
    return "\n".join(make(evidence.load(measurements)))


def with_blocks(file, text):
    """The page with the tables that stand on it made again."""
    for name, entry in blocks[file].items():
        lines = made(entry)
        mark = rf"(<!-- {name}:[^\n]*-->\n).*?(<!-- end -->)"
        text, count = re.subn(mark, lambda m: f"{m[1]}{lines}\n{m[2]}", text, flags=re.S)
        if count != 1:
            sys.exit(f"{file}: found {count} blocks '<!-- {name}: ... --> ... <!-- end -->', expected one")
    return text


def with_appendix(file, text):
    """The page with its appendix in the place of the marks."""
    for name, entry in appendices.get(file, {}).items():
        mark = f"<!-- appendix: {name} -->\n"
        if text.count(mark) != 1:
            sys.exit(f"{file}: found {text.count(mark)} marks '{mark.strip()}', expected one")
        text = text.replace(mark, f"\n{made(entry)}\n")
    return text
