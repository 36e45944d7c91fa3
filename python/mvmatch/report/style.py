"""Looks of the report page: light and dark, screen and paper."""

from __future__ import annotations

CSS = """
:root { --ink: #1b2330; --soft: #566273; --line: #dde3ea; --page: #f6f8fa; --card: #ffffff;
  --bar: #2f6fae; --stripe: #d98b2b; --good: #1d6f42; --doubt: #8a5a00; --bad: #a3262a; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6ebf2; --soft: #9fadbd; --line: #324050;
  --page: #11171f; --card: #1a222d; --bar: #6fa8dc; --stripe: #f0b25c; --good: #7ed6a0;
  --doubt: #f2c36b; --bad: #ff9b9b; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--ink); line-height: 1.5;
  font: 15px/1.5 system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
main { max-width: 1020px; margin: 0 auto; padding: 28px 20px 60px; }
h1 { font-size: 26px; margin: 0 0 4px; overflow-wrap: anywhere; }
h2 { font-size: 18px; margin: 0 0 10px; }
p { margin: 0 0 10px; max-width: 76ch; }
.soft { color: var(--soft); }
.verdict { display: inline-block; font-weight: 600; margin: 8px 0 18px; padding: 5px 12px;
  border-radius: 6px; border: 1.5px solid currentColor; }
.good { color: var(--good); } .doubt { color: var(--doubt); } .bad { color: var(--bad); }
.tiles { display: grid; grid-template-columns: repeat(auto-fill, minmax(150px, 1fr)); gap: 10px;
  margin-bottom: 16px; }
.tile, section { background: var(--card); border: 1px solid var(--line); border-radius: 8px; }
.tile { padding: 10px 14px; }
.tile b { display: block; font-size: 22px; font-variant-numeric: tabular-nums; }
.tile span { color: var(--soft); font-size: 13px; }
section { padding: 16px 18px; margin-bottom: 16px; break-inside: avoid; }
.charts { display: flex; flex-wrap: wrap; gap: 12px 24px; margin: 6px 0 10px; }
figure { margin: 0; max-width: 100%; }
figcaption { color: var(--soft); font-size: 13px; max-width: 450px; }
svg { max-width: 100%; height: auto; display: block; }
svg .bar { fill: var(--bar); } svg .striped { fill: url(#stripes); }
svg .stripe { fill: var(--stripe); } svg .stripe-back { fill: var(--card); }
svg .grid { stroke: var(--line); } svg .frame { fill: none; stroke: var(--soft); }
svg text { fill: var(--soft); font-size: 11px; font-family: inherit; }
svg .axis { font-size: 12px; } svg .name { font-size: 13px; fill: var(--ink); }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: 3px 18px 3px 0; vertical-align: top; }
th { font-weight: 500; color: var(--soft); }
table.numbers td, table.numbers th { text-align: right; white-space: nowrap; }
.wide { overflow-x: auto; } .wide svg { min-width: 560px; }
tr + tr td, tr + tr th { border-top: 1px solid var(--line); }
td { overflow-wrap: anywhere; min-width: 8ch; }
table.numbers td { min-width: 0; }
ul { margin: 0; padding-left: 20px; }
pre { overflow-x: auto; font-size: 12.5px; margin: 8px 0 0; }
summary { cursor: pointer; color: var(--soft); }
footer { color: var(--soft); font-size: 13px; }
@media (max-width: 600px) { main { padding: 16px 10px 40px; } section { padding: 14px 12px; }
  figure > svg text { font-size: 14px; } .wide svg text { font-size: 13px; } }
@media print { .wide { overflow: visible; } .wide svg { min-width: 0; }
  body { background: #fff; } main { max-width: none; padding: 0; } }
"""
