"use strict";

// Tables: column names for narrow screens, and sorting by a click on a column's head.
const PREFIXES = { p: 1e-12, n: 1e-9, "µ": 1e-6, m: 1e-3, k: 1e3, M: 1e6, G: 1e9 };
const SUPERSCRIPTS = "⁰¹²³⁴⁵⁶⁷⁸⁹⁻";

function number(text) {
  const plain = text.trim().replaceAll("−", "-")
    .replace(/×10([⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+)/g, (_, power) =>
      "e" + [...power].map(c => "0123456789-"[SUPERSCRIPTS.indexOf(c)]).join(""));
  const found = plain.match(/(-?\d+\.?\d*(?:e-?\d+)?)(?:\s*\[[^\]]*\])?\s*([pnµmkMG](?=[A-Za-zΩ]))?/);
  return found ? parseFloat(found[1]) * (PREFIXES[found[2]] || 1) : -Infinity;
}

function sort(table, column, head) {
  const descending = head.ariaSort === "ascending";
  const key = row => row.cells[column]?.textContent ?? "";
  const compare = head.classList.contains("number")
    ? (a, b) => number(key(a)) - number(key(b))
    : (a, b) => key(a).localeCompare(key(b), undefined, { numeric: true });
  for (const body of table.tBodies) {
    const rows = [...body.rows].filter(row => !row.classList.contains("kind")).sort(compare);
    body.append(...(descending ? rows.reverse() : rows));
  }
  for (const other of table.tHead.rows[0].cells) other.ariaSort = null;
  head.ariaSort = descending ? "descending" : "ascending";
}

for (const table of document.querySelectorAll("table.sortable")) {
  const heads = [...table.tHead.rows[0].cells];
  // `innerText` would lay out the page for every table.
  const labels = heads.map(head => [...head.childNodes].map(node => node.textContent).join(" ").replace(/\s+/g, " "));
  for (const row of table.querySelectorAll("tbody tr:not(.kind)")) {
    [...row.cells].forEach((cell, k) => { cell.dataset.label = labels[k]; });
  }
  heads.forEach((head, k) => {
    head.tabIndex = 0;
    head.title = "Sort by this column";
    head.onclick = () => sort(table, k, head);
    head.onkeydown = event => { if (event.key === "Enter") sort(table, k, head); };
  });
}

// Contents: the part in view is marked; a choice closes the menu of a narrow screen.
const menu = document.getElementById("menu");
const entries = new Map([...document.querySelectorAll("nav > ul > li > a")].map(a => [a.hash.slice(1), a.parentElement]));
const seen = new IntersectionObserver(changes => {
  for (const change of changes.filter(c => c.isIntersecting)) {
    for (const entry of entries.values()) entry.classList.toggle("current", entry === entries.get(change.target.id));
  }
}, { rootMargin: "-10% 0px -85% 0px" });
for (const id of entries.keys()) seen.observe(document.getElementById(id));
document.querySelector("nav").onclick = event => { if (event.target.tagName === "A") menu.checked = false; };

// A link into a folded part unfolds it.
function unfold() {
  const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  for (let fold = target?.closest("details"); fold; fold = fold.parentElement.closest("details")) fold.open = true;
}
addEventListener("hashchange", unfold);
unfold();

// Printed figures: a click enlarges a sheet, another one enlarges it further.
const zoom = document.getElementById("zoom");
for (const link of document.querySelectorAll("a.sheet")) {
  link.onclick = event => {
    if (event.ctrlKey || event.metaKey || event.shiftKey) return;
    event.preventDefault();
    zoom.className = innerWidth < 800 ? "large" : "";
    zoom.querySelector("img").src = link.querySelector("img").src;
    zoom.showModal();
  };
}
zoom.querySelector("img").onclick = event => {
  const { offsetX, offsetY, target } = event;
  const share = [offsetX / target.clientWidth, offsetY / target.clientHeight];
  zoom.classList.toggle("large");
  zoom.scrollTo(share[0] * target.clientWidth - innerWidth / 2, share[1] * target.clientHeight - innerHeight / 2);
};

// Interactive figures: made when their part is opened.
async function text(id) {
  const bytes = Uint8Array.from(atob(document.getElementById(id).textContent), c => c.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
}

let shared;
async function library() {
  const [script, templates] = await Promise.all([text("bokeh"), text("templates")]);
  const element = document.createElement("script");
  element.textContent = script;
  document.head.append(element);
  return JSON.parse(templates);
}

function values(increments, step) {
  let count = 0;
  return increments.map(increment => increment === null ? NaN : (count += increment) * step);
}

function columns(record) {
  const data = { x: record.x };
  const nothing = record.x.map(() => NaN);
  for (const name of ["observed", "median", ...["predictive", "discrepancy", "parameter"].flatMap(
    band => [`${band}_lower`, `${band}_upper`])]) {
    data[name] = record.curves[name] ? values(record.curves[name], record.step) : nothing;
    if (name !== "observed" && name !== "median") data[`${name}_residual`] = data[name].map((v, k) => v - data.median[k]);
  }
  data.residual = data.observed.map((v, k) => v - data.median[k]);
  data.zero = record.x.map(() => 0);
  return data;
}

async function show(place, record, templates) {
  const plot = place.querySelector(".plot");
  plot.replaceChildren();
  plot.id ||= `${place.dataset.curves}-plot`;
  const views = await Bokeh.embed.embed_item(structuredClone(templates[record.axes]), plot.id);
  const figure = views.roots[0].model.document;
  figure.get_model_by_name("curves").data = columns(record);
  record.labels.forEach((label, k) => { figure.get_model_by_name(`label${k}`).axis_label = label; });
  const [kept, every] = record.points;
  place.querySelector(".points").textContent = kept < every ? `${kept} of ${every} points are shown. ` : "";
}

async function open(place) {
  if (place.dataset.state) return;
  place.dataset.state = "loading";
  const templates = await (shared ||= library());
  const records = JSON.parse(await text(place.dataset.curves));
  const choice = place.querySelector("select");
  choice.replaceChildren(...records.map((record, k) => new Option(`${record.name} (${record.role})`, k)));
  choice.onchange = () => show(place, records[choice.value], templates);
  await show(place, records[0], templates);
  place.dataset.state = "shown";
}

for (const fold of document.querySelectorAll("details.figure")) {
  fold.addEventListener("toggle", () => {
    if (fold.open) for (const place of fold.querySelectorAll(".live")) open(place);
  });
}
