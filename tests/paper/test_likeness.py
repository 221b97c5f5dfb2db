"""How like people somebody is: against numbers of the paper, scipy, and means made up by hand."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from scipy import stats

from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.references import POINT
from causal_openlock.paper.likeness import (
    EFFECTS,
    PUBLISHED_MODEL,
    distance,
    effects_of,
    likeness,
    points_of,
    points_of_model,
    points_of_people,
)
from causal_openlock.paper.likeness_section import (
    MOST_DRAWN,
    TOPIC,
    draw_points,
    plot_likeness,
    signs,
)
from support.fabricated_records import table
from support.made_up_experiments import BESIDE_ALL, NOBODY
from support.made_up_people import made_up
from support.topics import section_on

pytestmark = pytest.mark.slow


def material(*trials, references=None):
    whole = pd.concat(trials, ignore_index=True)
    names = tuple(dict.fromkeys(whole["learner"]))
    if references is None:
        references = BESIDE_ALL
    return Material(table([]), NOBODY, whole, pd.DataFrame(), names, references, {})


def by_name(effects, name):
    return effects.set_index("effect").loc[name]


def test_people_show_every_effect_and_the_published_model_all_but_one():
    effects = effects_of(points_of_people()).set_index("effect")
    assert effects["like_people"].all()
    printed = {"CE harder, last trial": 2.00, "congruency, CC4": 2.62, "congruency, CE4": 4.27}
    for name, t in printed.items():
        assert effects.loc[name, "p"] == pytest.approx(2 * stats.t.sf(t, 78), rel=0.02)
        half = effects.loc[name, "high"] - effects.loc[name, "difference"]
        error = effects.loc[name, "difference"] / t
        assert half == pytest.approx(stats.t.ppf(0.975, 78) * error, rel=0.005)
    missing = effects_of(points_of_model()).query("not like_people")
    assert missing["effect"].tolist() == ["congruency, CC4"]


def test_the_distance_is_the_root_mean_square_over_points():
    points = points_of(made_up(off=2.0))
    error = points_of_people()["se"].to_numpy()
    assert distance(points) == pytest.approx((2.0, np.sqrt((4 / error**2).mean())))
    assert distance(points_of(made_up()))[0] == pytest.approx(0.0, abs=1e-12)
    two = points_of_people().iloc[:2].copy()  # up and down do not cancel
    two["mean"] = two["people_mean"] + [3.0, -4.0]
    assert distance(two)[0] == pytest.approx(np.sqrt(12.5))


def test_points_come_in_the_order_of_publication_with_the_mean_over_subjects():
    trials = made_up(seed=3)
    training = trials.query("condition == 'CC3-CC4'").assign(phase="train")  # is no point
    points = points_of(pd.concat([trials, training]).sample(frac=1, random_state=1))
    assert (points[POINT].to_numpy() == points_of_people()[POINT].to_numpy()).all()
    own = trials.query("condition == 'CE4' and trial == 2")["attempts"]
    point = points.query("condition == 'CE4' and trial == 2").iloc[0]
    assert point["mean"] == pytest.approx(own.mean())
    assert point["se"] == pytest.approx(own.std(ddof=0) / np.sqrt(12))


def test_learning_of_a_learner_is_tested_within_its_subjects():
    trials = made_up(seed=2)
    own = trials.query("condition == 'CC4'").pivot(
        index="subject", columns="trial", values="attempts"
    )
    expected = stats.ttest_rel(own[1], own[5])
    found = by_name(effects_of(points_of(trials), trials), "learning, CC4")
    interval = expected.confidence_interval()
    assert [found["p"], found["low"], found["high"]] == pytest.approx([expected.pvalue, *interval])
    # From means alone it is a comparison of two groups.
    apart = by_name(effects_of(points_of(trials)), "learning, CC4")
    assert apart["p"] == pytest.approx(stats.ttest_ind(own[1], own[5]).pvalue)
    last = trials["trial"] == 5  # a gain that is the same in every subject has no interval
    first = trials[trials["trial"] == 1].set_index(["condition", "subject"])["attempts"]
    at = pd.MultiIndex.from_frame(trials.loc[last, ["condition", "subject"]])
    trials.loc[last, "attempts"] = first.reindex(at).to_numpy() - 2
    found = by_name(effects_of(points_of(trials), trials), "learning, CC4")
    assert found["difference"] == pytest.approx(2)
    assert np.isnan(found["low"])
    assert found["p"] == pytest.approx(2 / 2**12)  # the sign test


def test_an_effect_in_the_other_direction_or_of_no_size_is_none():
    points = points_of_people()
    swapped = {"CC3-CE4": "CE3-CE4", "CE3-CE4": "CC3-CE4"}
    points["condition"] = points["condition"].replace(swapped)
    effects = effects_of(points)
    assert not by_name(effects, "congruency, CE4")["like_people"]
    assert by_name(effects, "congruency, CC4")["like_people"]
    assert by_name(effects, "congruency, CE4")["difference"] == pytest.approx(-6.025)
    none = effects_of(points_of_people().assign(mean=5.0, se=0.0))
    assert not none["like_people"].any()
    assert none["p"].isna().all()


def test_the_nearest_stands_first_and_a_learner_with_fewer_points_is_left_out():
    part = made_up("part").query("condition == 'CC4'")
    assert effects_of(points_of(part))["effect"].tolist() == ["learning, CC4"]
    trials = pd.concat([made_up("far", off=-4.0), part, made_up("near", off=0.5)])
    like = likeness(trials, BESIDE_ALL[1], ["far", "part", "near"])
    rmse = {name: distance(own)[0] for name, own in like.points.items()}
    assert [*rmse] == ["near", PUBLISHED_MODEL, "far"]
    assert [*rmse.values()] == pytest.approx([0.5, 3.057, 4.0], abs=1e-3)
    shown = [like.effects[name]["like_people"].sum() for name in rmse]
    assert shown == [len(EFFECTS), len(EFFECTS) - 1, len(EFFECTS)]


def test_a_sign_alone_is_not_clear_of_chance():
    effects = effects_of(points_of_model())
    assert [word for word in signs(effects).split() if word.isdigit()] == ["5", "6", "5"]
    doubtful = effects.assign(p=effects["p"].where(effects["effect"] != "learning, CC4", 0.4))
    assert [word for word in signs(doubtful).split() if word.isdigit()] == ["5", "6", "4"]
    wrong = effects.assign(p=0.001)  # the wrong sign, clear of chance, counts for nothing
    assert [word for word in signs(wrong).split() if word.isdigit()] == ["5", "6", "5"]


def test_without_all_six_conditions_people_or_their_protocol_there_is_no_section():
    whole = made_up()
    assert section_on(TOPIC, material(whole)) is not None
    assert section_on(TOPIC, material(whole.query("condition != 'CC3-CE4'"))) is None
    assert section_on(TOPIC, material(whole.assign(protocol="rl"))) is None
    assert section_on(TOPIC, material(whole, references=())) is None


def test_panels_have_the_means_of_the_nearest_learners_and_the_published_model():
    order = [*range(1, MOST_DRAWN + 2), 0]  # the nearest is the last of them
    everybody = material(*(made_up(f"learner {i}", off=i) for i in order))
    titles = [axes.get_title(loc="left") for axes in plot_likeness(everybody, ax=Figure())]
    assert titles == [*(f"learner {i}" for i in range(MOST_DRAWN)), PUBLISHED_MODEL]
    (one, _) = plot_likeness(everybody, learners=["learner 6"], ax=Figure())
    assert one.get_title(loc="left") == "learner 6"
    points = points_of(made_up(off=30.0))
    axes = draw_points({"a": points}, {"a": effects_of(points)}, Figure())
    drawn = sorted(y for line in axes.lines for y in line.get_ydata())
    for value in (*points["mean"], *points["people_mean"]):
        assert np.isclose(drawn, value).any()
    assert axes.get_ylim()[1] > points["mean"].max()
