// Put into a page of a report by test_report_in_a_browser.py: uses its controls and writes down what it finds.
(async () => {
const $ = (s, e = document) => e.querySelector(s), $$ = (s, e = document) => [...e.querySelectorAll(s)], found = {};
const rest = () => new Promise(done => setTimeout(done, 30));
const act = (e, kind) => e.dispatchEvent(new Event(kind, { bubbles: true }));
const figure = name => $(`svg[data-name="${name}"]`).closest("figure");
found.above = $("#appendix").getBoundingClientRect().top + scrollY;
found.wide = [document.documentElement.scrollWidth, innerWidth];
$$("details").forEach(d => { d.open = true; });
await rest();
found.open = [document.documentElement.scrollWidth, innerWidth];
// the section, its slider and the ring
const f = figure("deformed"), slider = $("input[type=range]", f), state = () => [
  $(".edge", f).getAttribute("d"), $("output", f).textContent, $(".dot").getAttribute("cy"), $$(".band", f).map(b => b.getAttribute("d")).join()];
const deep = state(); slider.value = 0; act(slider, "input"); const flat = state();
found.moved = deep.map((v, k) => v !== flat[k]);
slider.value = 2; act(slider, "input");
found.said = $("output", f).textContent;
const which = $("select", f), bar = $(".bar", f).textContent; which.value = which.options[1].value; act(which, "change");
found.field = [bar, $(".bar", f).textContent];
// tables
const runs = $$("table").find(t => t.rows.length > 30), first = () => runs.tBodies[0].rows[0].textContent;
const before = first(); $$("th button", runs)[2].click(); const up = first(); $$("th button", runs)[2].click();
found.sorted = [before !== up, up !== first(), $$("th", runs)[2].getAttribute("aria-sort")];
const filter = runs.parentElement.previousElementSibling; filter.value = "crashed"; act(filter, "input");
found.filtered = [...runs.tBodies[0].rows].filter(r => !r.hidden).map(r => r.textContent.includes("crashed"));
// legends and values under the pointer
const curve = figure("curve-0"), toggle = $("button[aria-pressed]", curve), groups = () => $$("svg g", curve).filter(g => g.style.display === "none").length;
const shown = groups(); toggle.click(); const hidden = groups(); toggle.click(); found.toggled = [shown, hidden, groups()];
curve.scrollIntoView(); const svg = $("svg", curve), data = JSON.parse($("metadata.data", svg).textContent), s = data.series[0];
const q = new DOMPoint(...s.p[10]).matrixTransform(svg.getScreenCTM());
svg.dispatchEvent(new PointerEvent("pointermove", { clientX: q.x, clientY: q.y }));
found.tip = [$(".tip", curve).textContent, s.x[10], s.y[10]];
// a part of a figure: by dragging, by keys, and back
const box = () => svg.getAttribute("viewBox").split(" ").map(Number), whole = box(), size = svg.getBoundingClientRect().height;
const mode = $("button.mode", curve), hit = (type, x, y) => { const m = new DOMPoint(x, y).matrixTransform(svg.getScreenCTM()); svg.dispatchEvent(new PointerEvent(type, { clientX: m.x, clientY: m.y, bubbles: true })); };
const capture = Element.prototype.setPointerCapture; Element.prototype.setPointerCapture = () => {};
mode.click(); hit("pointerdown", 100, 50); hit("pointermove", 150, 70); hit("pointerup", 150, 70); const part = box();
const kept = Math.abs(svg.getBoundingClientRect().height - size) < 1;
svg.dispatchEvent(new KeyboardEvent("keydown", { key: "+" })); const closer = box();
svg.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight" })); const beside = box();
svg.dispatchEvent(new KeyboardEvent("keydown", { key: "Escape" })); found.zoom = { whole, part, kept, closer, beside, back: box() };
mode.click(); Element.prototype.setPointerCapture = capture;
// downloads: what would be saved
const saved = []; const click = HTMLAnchorElement.prototype.click;
HTMLAnchorElement.prototype.click = function () { saved.push([this.download, this.href]); };
for (const b of $$(".tools button", curve)) if (["SVG", "CSV"].includes(b.textContent)) b.click();
HTMLAnchorElement.prototype.click = click;
found.saved = [];
for (const [name, href] of saved) found.saved.push([name, await (await fetch(href)).text()]);
// names, headings, ids
const name = e => (e.getAttribute("aria-label") || e.textContent || "").trim();
found.nameless = $$("button, a, input, select, svg[role=img], canvas, [role=region]").filter(e => !name(e)).map(e => e.outerHTML.slice(0, 80));
found.pictures = $$("figure").filter(e => !$("svg[role=img]", e)).length;
found.flat = $$("figure").filter(e => e.getBoundingClientRect().height < 40).map(e => e.textContent.slice(0, 40));
found.levels = $$("h1, h2, h3").map(e => +e.tagName[1]);
const ids = $$("[id]").map(e => e.id); found.twice = ids.filter((v, k) => ids.indexOf(v) !== k);
found.over = $$("main *").filter(e => e.getBoundingClientRect().right > innerWidth + 1 && !e.closest(".scroll") && !e.closest("svg")).map(e => e.outerHTML.slice(0, 80));
found.unreachable = $$("*").filter(e => getComputedStyle(e).overflowX === "auto" && e.scrollWidth > e.clientWidth + 1 && e.tabIndex < 0).map(e => e.outerHTML.slice(0, 80));
// contrast of all text, light and dark
const rgb = c => (c.match(/[\d.]+/g) || []).map(Number), light = c => { const [r, g, b] = rgb(c).map(v => (v /= 255) <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4); return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
const behind = e => { for (; e; e = e.parentElement) { const c = getComputedStyle(e).backgroundColor; if (rgb(c)[3] !== 0) return c; } return "rgb(255,255,255)"; };
found.pale = {};
for (const theme of ["light", "dark"]) {
  document.documentElement.dataset.theme = theme; await rest();
  found.pale[theme] = $$("p, h1, h2, h3, td, th, figcaption, li, a, button, summary, .label, .value, .note, output, .said, .what").filter(e => e.textContent.trim()).map(e => {
    const a = light(getComputedStyle(e).color), b = light(behind(e)); return [(Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05), e.tagName, e.className, e.textContent.trim().slice(0, 30)];
  }).filter(r => r[0] < 4.5);
}
found.asked = performance.getEntriesByType("resource").map(e => e.name).filter(n => !n.startsWith("blob:"));
found.wrong = wrong;
(parent === window ? document : parent.document).title = "looked";
const out = document.createElement("pre"); out.id = "found"; out.textContent = JSON.stringify(found);
(parent === window ? document : parent.document).body.append(out);
})().catch(e => { document.body.append(Object.assign(document.createElement("pre"), { id: "found", textContent: JSON.stringify({ broken: String(e.stack) }) })); });
