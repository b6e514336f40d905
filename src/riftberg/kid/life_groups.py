"""The parameter groups ``melt``, ``rolling`` and ``footloose`` of a KID namelist (files 7.1)."""

from __future__ import annotations

from typing import Any, Final

from riftberg.kid.namelist import NamelistGroup

_TIP_OF_SCHEME_TWO: Final = 999.0


def life_groups(group: NamelistGroup) -> dict[str, dict[str, Any]]:
    """Return the parameter groups ``melt``, ``rolling`` and ``footloose`` of a namelist."""
    return {"melt": _melt(group), "rolling": _rolling(group), "footloose": _footloose(group)}


def _melt(group: NamelistGroup) -> dict[str, Any]:
    shelf, mixed = group.flag("melt_icebergs_as_ice_shelf"), group.flag("use_mixed_melting")
    equations = "three_equation" if group.flag("Use_three_equation_model") else "two_equation"
    cutoff = group.number("melt_cutoff")
    return {
        "enabled": True,
        "mode": "mixed" if mixed else ("shelf" if shelf else "berg"),
        "base": equations if mixed or shelf else "turbulent",
        "salinity_from_ocean": group.flag("use_mixed_layer_salinity_for_thermo"),
        "split": group.flag("use_operator_splitting"),
        "sea_ice_shift": group.number("sicn_shift"),
        "bits_fraction": max(group.number("bergy_bit_erosion_fraction"), 0.0),
        "zero_rates": group.flag("set_melt_rates_to_zero"),
        "keep_shape": group.flag("Iceberg_melt_without_decay"),
        "const_gamma": group.flag("const_gamma"),
        "gamma_t": group.number("Gamma_T_3EQ"),
        "friction_drag": group.number("cdrag_icebergs"),
        "least_friction": group.number("ustar_icebergs_bg"),
        "tide": group.number("utide_icebergs"),
        "least_gap": cutoff if cutoff >= 0.0 and group.flag("apply_thickness_cutoff_to_bergs_melt") else None,
    }


def _rolling(group: NamelistGroup) -> dict[str, Any]:
    tip = group.number("tip_parameter")
    older = "weeks_mellor" if tip >= _TIP_OF_SCHEME_TWO else "legacy"
    scheme = "updated" if group.flag("use_updated_rolling_scheme") else older
    return {"enabled": group.flag("allow_bergs_to_roll"), "scheme": scheme, "tip": tip}


def _footloose(group: NamelistGroup) -> dict[str, Any]:
    return {
        "enabled": group.flag("footloose"),
        "youngs": group.number("fl_youngs"),
        "strength": 1000.0 * group.number("fl_strength"),
        "style": "bergs" if group.text("fl_style") == "new_bergs" else "bits",
        "displace": group.flag("displace_fl_bergs"),
        "one_draw": group.flag("fl_init_child_xy_by_pe"),
        "berg_mass": group.number("new_berg_from_fl_bits_mass_thres"),
    }
