// Everything here is an addition: without it the page shows the same numbers and pictures.
(() => {
"use strict";
const $ = (s, e = document) => e.querySelector(s), $$ = (s, e = document) => [...e.querySelectorAll(s)];
const make = (tag, props = {}, ...kids) => { const e = Object.assign(document.createElement(tag), props); e.append(...kids); return e; };
const words = JSON.parse($("#words")?.textContent || "{}"), say = s => words[s] || s, comma = document.documentElement.lang === "de" ? "," : ".";
const shown = v => String(v).replace(".", comma);
const dataOf = svg => { const m = $("metadata.data", svg); try { return m ? JSON.parse(m.textContent) : null; } catch { return null; } };

// --- theme: the system's, unless a reader says otherwise
{
  const root = document.documentElement, dark = matchMedia("(prefers-color-scheme: dark)");
  const now = () => root.dataset.theme || (dark.matches ? "dark" : "light");
  const b = make("button", { className: "theme", type: "button" });
  const label = () => { const other = now() === "dark" ? "Light" : "Dark"; b.textContent = say(other); b.setAttribute("aria-label", say(`Switch to the ${other.toLowerCase()} theme`)); };
  b.onclick = () => { root.dataset.theme = now() === "dark" ? "light" : "dark"; label(); };
  label(); document.body.append(b);
}

// --- closed parts open where a link leads into them
const reveal = () => {
  const e = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
  for (let d = e && e.closest("details"); d; d = d.parentElement.closest("details")) d.open = true;
  if (e && e.tagName === "DETAILS") e.open = true;
  if (e) e.scrollIntoView();
};
addEventListener("hashchange", reveal); reveal();
for (const h of $$("section[id] > h2, summary > h2")) {
  const s = h.closest("section[id], details[id]");
  if (s && h.parentElement.tagName !== "SUMMARY") h.append(make("a", { className: "anchor", href: `#${s.id}`, textContent: "#", ariaLabel: `${say("Link to")} ${h.textContent.trim()}` }));
}

// --- the deformed section: depth, field, and the ring on the curve
const polygons = (x, t, v, level) => {
  let d = "";
  for (let k = 0; k < t.length; k += 3) {
    let some = "";
    for (let e = 0; e < 3; e++) {
      const a = t[k + e], b = t[k + (e + 1) % 3], ina = v[a] >= level, inb = v[b] >= level;
      if (ina) some += (some ? "L" : "M") + x[2 * a].toFixed(1) + "," + x[2 * a + 1].toFixed(1);
      if (ina !== inb) {
        const s = (level - v[a]) / (v[b] - v[a]);
        some += (some ? "L" : "M") + (x[2 * a] + s * (x[2 * b] - x[2 * a])).toFixed(1) + "," + (x[2 * a + 1] + s * (x[2 * b + 1] - x[2 * a + 1])).toFixed(1);
      }
    }
    if (some) d += some + "Z";
  }
  return d;
};
const lines = (x, t) => {  // borders of the triangles, which stand the same way round
  const there = new Set(), n = x.length;
  for (let k = 0; k < t.length; k += 3) for (let e = 0; e < 3; e++) there.add(t[k + e] * n + t[k + (e + 1) % 3]);
  const out = [];
  for (const c of there) { const a = Math.floor(c / n), b = c % n; if (!there.has(b * n + a)) out.push([a, b]); }
  return out;
};
const hero = svg => {
  const data = dataOf(svg), curve = $$("svg").map(s => [s, dataOf(s)]).find(([, d]) => d && d.kind === "pressed");
  let last = null;
  for (const f of data.frames) { f.t = f.t || last; last = f.t; }
  const bands = $$(".band", svg), edge = $(".edge", svg), tool = $(".indenter", svg), bar = $(".bar", svg);
  const axis = data.axis, flip = x => x.map((c, i) => i % 2 ? c : 2 * axis - c);
  const turn = t => { const o = []; for (let k = 0; k < t.length; k += 3) o.push(t[k], t[k + 2], t[k + 1]); return o; };
  const rest = data.frames[0];
  const draw = (k, field) => {
    const f = data.frames[k], look = data.fields[field], v = f.v[field];
    const sides = axis === null ? [[f.x, f.t]] : [[f.x, f.t], [flip(f.x), turn(f.t)]];
    bands.forEach((p, b) => {
      const level = b === 0 ? -Infinity : look.levels[b];
      p.setAttribute("fill", look.colours[b] || "none");
      p.setAttribute("d", b < look.colours.length ? sides.map(([x, t]) => polygons(x, t, v, level)).join("") : "");
    });
    let d = "";
    for (const [x, t] of sides) for (const [a, b] of lines(x, t)) {
      if (axis !== null && Math.abs(x[2 * a] - axis) < 0.06 && Math.abs(x[2 * b] - axis) < 0.06) continue;
      d += `M${x[2 * a]},${x[2 * a + 1]}L${x[2 * b]},${x[2 * b + 1]}`;
    }
    edge.setAttribute("d", d);
    tool.setAttribute("d", "M" + f.i.reduce((s, c, i) => s + (i % 2 ? "," : i ? "L" : "") + c, "") + "Z");
    if (curve) {
      const dot = $(".dot", curve[0]);
      dot.setAttribute("cx", curve[1].dots[k][0]); dot.setAttribute("cy", curve[1].dots[k][1]);
    }
    return curve ? `${shown(+f.u.toPrecision(3))} mm, ${curve[1].said[k]}` : `${shown(+f.u.toPrecision(3))} mm`;
  };
  const names = Object.keys(data.fields), most = Math.max(...names.map(n => data.fields[n].colours.length));
  while (bands.length < most) { const p = bands[0].cloneNode(); p.setAttribute("d", ""); bands[bands.length - 1].after(p); bands.push(p); }
  const scale = field => {  // the scale of colours of another field
    const look = data.fields[field], n = look.colours.length, x = data.place.wide + 18, top = 12, height = data.place.tall - 26, ns = svg.namespaceURI;
    bar.textContent = "";
    const put = (tag, props, text) => { const e = document.createElementNS(ns, tag); for (const k in props) e.setAttribute(k, props[k]); if (text) e.textContent = text; bar.append(e); };
    const label = { "font-family": "DejaVu Sans", fill: "var(--ink)" };
    const said = `${field} (${look.unit})`, size = Math.min(13, Math.max(8, Math.floor(data.place.tall / (0.6 * said.length))));  // a thin section is low
    put("text", { x: x + 64, y: 0, "font-size": size, "text-anchor": "middle", transform: `rotate(-90 ${x + 64} 0) translate(${-data.place.tall / 2} 0)`, ...label }, said);
    look.colours.forEach((c, k) => put("rect", { x, y: top + height * (1 - (k + 1) / n), width: 16, height: height / n + 0.4, fill: c }));
    const every = Math.max(1, Math.ceil((n + 1) / 7));
    for (let k = 0; k <= n; k += every) put("text", { x: x + 22, y: top + height * (1 - k / n) + 4.5, "font-size": 12, ...label }, look.labels[k]);
  };
  const end = data.frames.length - 1;
  const slider = make("input", { type: "range", min: 0, max: end, step: 1, value: end, ariaLabel: say("Depth of the section") });
  const out = make("output", {}), which = make("select", { ariaLabel: say("What is coloured") });
  for (const n of names) which.append(make("option", { value: n, textContent: n }));
  const play = make("button", { type: "button", textContent: say("Press") });
  const go = () => { out.textContent = draw(+slider.value, which.value); slider.setAttribute("aria-valuetext", out.textContent); };
  let timer = 0;
  slider.oninput = () => { clearInterval(timer); go(); };
  which.onchange = () => { scale(which.value); go(); };
  play.onclick = () => {
    clearInterval(timer); slider.value = 0; go();
    timer = setInterval(() => { if (+slider.value >= end) return clearInterval(timer); slider.value = +slider.value + 1; go(); }, 220);
  };
  svg.closest("figure").insertBefore(make("div", { className: "hero" }, play, slider, out, which), svg.nextSibling);
  out.textContent = curve ? `${shown(+data.frames[end].u.toPrecision(3))} mm, ${curve[1].said[end]}` : "";
};

// --- a body that turns: the surface of the last frame, painter's order, own colours
const turnable = svg => {
  const data = dataOf(svg), figure = svg.closest("figure"), W = 640, H = 400;
  const canvas = make("canvas", { width: 2 * W, height: 2 * H, tabIndex: 0 });
  canvas.setAttribute("role", "img"); canvas.setAttribute("aria-label", svg.getAttribute("aria-label") + " " + say("Arrow keys turn it."));
  canvas.style.cssText = "width:100%;height:auto;touch-action:pan-y;cursor:grab";
  const g = canvas.getContext("2d"), P = data.points, T = data.triangles, V = data.bands, B = data.bright;
  const rgb = data.colours.map(c => [1, 3, 5].map(k => parseInt(c.slice(k, k + 2), 16)));
  const tone = T.filter((_, k) => k % 3 === 0).map((_, k) => `rgb(${rgb[V[k]].map(c => Math.round(c * (B ? B[k] : 1))).join()})`);
  let yaw = data.yaw, pitch = data.pitch, drag = null, waiting = false;
  const paint = () => {
    waiting = false;
    const cy = Math.cos(yaw), sy = Math.sin(yaw), cp = Math.cos(pitch), sp = Math.sin(pitch), n = P.length / 3, X = new Float64Array(n), Y = new Float64Array(n), Z = new Float64Array(n);
    const s = 2;
    for (let k = 0; k < n; k++) {
      const x = P[3 * k], y = P[3 * k + 1], z = P[3 * k + 2], a = cy * x - sy * y, b = sy * x + cy * y;
      X[k] = W + s * a; Y[k] = H - s * (sp * b + cp * z); Z[k] = cp * b - sp * z;
    }
    const m = T.length / 3, order = Array.from({ length: m }, (_, k) => k), deep = order.map(k => Z[T[3 * k]] + Z[T[3 * k + 1]] + Z[T[3 * k + 2]]);
    order.sort((a, b) => deep[b] - deep[a]);
    g.clearRect(0, 0, 2 * W, 2 * H); g.lineJoin = "round";
    for (const k of order) {
      const a = T[3 * k], b = T[3 * k + 1], c = T[3 * k + 2];
      g.beginPath(); g.moveTo(X[a], Y[a]); g.lineTo(X[b], Y[b]); g.lineTo(X[c], Y[c]); g.closePath();
      g.fillStyle = g.strokeStyle = tone[k]; g.fill(); g.lineWidth = 1; g.stroke();
    }
    const style = getComputedStyle(canvas), ink = style.getPropertyValue("--ink"), accent = style.getPropertyValue("--accent");
    g.font = "26px system-ui, sans-serif"; g.fillStyle = ink;
    const at = q => { const a = cy * q[0] - sy * q[1], b = sy * q[0] + cy * q[1]; return [W + s * a, H - s * (sp * b + cp * q[2])]; };
    for (const l of data.lines || []) { g.beginPath(); l.points.forEach((q, i) => g[i ? "lineTo" : "moveTo"](...at(q))); g.strokeStyle = l.strong ? accent : ink; g.lineWidth = l.strong ? 6 : 2; g.stroke(); }
    for (const l of data.texts || []) { const [x, y] = at(l.at); g.textAlign = "center"; g.fillText(l.text, x, y); }
  };
  const later = () => { if (!waiting) { waiting = true; requestAnimationFrame(paint); } };
  canvas.onpointerdown = e => { drag = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); };
  canvas.onpointermove = e => { if (!drag) return; yaw += (e.clientX - drag[0]) / 120; pitch = Math.max(-0.2, Math.min(1.5, pitch + (e.clientY - drag[1]) / 160)); drag = [e.clientX, e.clientY]; later(); };
  canvas.onpointerup = canvas.onpointercancel = () => { drag = null; };
  canvas.onkeydown = e => { const k = { ArrowLeft: [-0.15, 0], ArrowRight: [0.15, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[e.key]; if (!k) return; e.preventDefault(); yaw += k[0]; pitch = Math.max(-0.2, Math.min(1.5, pitch + k[1])); later(); };
  svg.style.display = "none"; svg.before(canvas); paint();
  new MutationObserver(later).observe(document.documentElement, { attributes: true });
};

// --- figures: values under the pointer, legends, downloads
const save = (name, type, text) => { const a = make("a", { download: name, href: URL.createObjectURL(new Blob([text], { type })) }); a.click(); setTimeout(() => URL.revokeObjectURL(a.href), 1000); };
const asFile = svg => {  // colours of the page become colours of the file
  const copy = svg.cloneNode(true), style = getComputedStyle(svg);
  $$("metadata", copy).forEach(m => m.remove());
  copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
  copy.style.display = ""; copy.style.cursor = "";
  if (svg.dataset.whole) copy.setAttribute("viewBox", svg.dataset.whole);
  return new XMLSerializer().serializeToString(copy).replace(/var\((--[a-z]+)\)/g, (_, n) => style.getPropertyValue(n).trim());
};
const cell = v => /[",\n]/.test(v = String(v)) ? `"${v.replace(/"/g, '""')}"` : v;
const zoom = (svg, button) => {  // a part of a figure, by its view box: sizes of the page stay
  const whole = svg.getAttribute("viewBox").split(/[ ,]+/).map(Number), [X, Y, W, H] = whole;
  const now = () => svg.getAttribute("viewBox").split(/[ ,]+/).map(Number);
  const show = (cx, cy, s) => {
    s = Math.max(1, Math.min(s, 20));
    const w = W / s, h = H / s, x = Math.max(X, Math.min(cx - w / 2, X + W - w)), y = Math.max(Y, Math.min(cy - h / 2, Y + H - h));
    svg.setAttribute("viewBox", [x, y, w, h].map(v => +v.toFixed(3)).join(" ")); back.hidden = s === 1;
  };
  const at = e => new DOMPoint(e.clientX, e.clientY).matrixTransform(svg.getScreenCTM().inverse());
  const on = () => enter.getAttribute("aria-pressed") === "true";
  const enter = button(say("Zoom"), `${say("Zoom")}: ${svg.dataset.name}. ${say("Enlarge a part: drag over it, or use plus, minus and the arrow keys")}`, () => {
    enter.setAttribute("aria-pressed", !on()); svg.style.cursor = on() ? "crosshair" : ""; svg.style.touchAction = on() ? "none" : "";
    if (on()) { svg.tabIndex = 0; svg.focus({ preventScroll: true }); } else { svg.removeAttribute("tabindex"); reset(); }
  });
  enter.className = "mode"; enter.setAttribute("aria-pressed", "false");
  enter.title = say("Enlarge a part: drag over it, or use plus, minus and the arrow keys");
  const reset = () => show(X + W / 2, Y + H / 2, 1);
  const back = button(say("Whole figure"), `${say("Whole figure")}: ${svg.dataset.name}`, reset); back.hidden = true;
  let start = null, frame = null;
  svg.addEventListener("pointerdown", e => {
    if (!on() || e.button) return;
    start = at(e); svg.setPointerCapture(e.pointerId); e.preventDefault(); svg.focus({ preventScroll: true });
    frame = document.createElementNS(svg.namespaceURI, "rect"); frame.setAttribute("class", "frame"); svg.append(frame);
  });
  svg.addEventListener("pointermove", e => {
    if (!start) return;
    const q = at(e); for (const [k, v] of Object.entries({ x: Math.min(q.x, start.x), y: Math.min(q.y, start.y), width: Math.abs(q.x - start.x), height: Math.abs(q.y - start.y) })) frame.setAttribute(k, v);
  });
  const end = e => {
    if (!start) return;
    const q = at(e), p = start; start = null; frame.remove();
    const w = Math.abs(q.x - p.x), h = Math.abs(q.y - p.y);
    if (e.type === "pointerup" && Math.max(w / W, h / H) > 0.02) show((q.x + p.x) / 2, (q.y + p.y) / 2, 1 / Math.max(w / W, h / H));
  };
  svg.addEventListener("pointerup", end); svg.addEventListener("pointercancel", end);
  svg.addEventListener("dblclick", () => { if (on()) reset(); });
  svg.addEventListener("keydown", e => {
    if (!on()) return;
    const [x, y, w, h] = now(), cx = x + w / 2, cy = y + h / 2, s = W / w, d = 0.15;
    const to = { "+": [cx, cy, 1.4 * s], "=": [cx, cy, 1.4 * s], "-": [cx, cy, s / 1.4], ArrowLeft: [cx - d * w, cy, s], ArrowRight: [cx + d * w, cy, s], ArrowUp: [cx, cy - d * h, s], ArrowDown: [cx, cy + d * h, s], Escape: [X + W / 2, Y + H / 2, 1] }[e.key];
    if (to) { e.preventDefault(); show(...to); }
  });
  svg.dataset.whole = whole.join(" ");
};
const tools = (figure, svg) => {
  const data = dataOf(svg), name = svg.dataset.name, bar = make("div", { className: "tools" });
  const button = (text, label, act) => { const b = make("button", { type: "button", textContent: text, onclick: act }); b.setAttribute("aria-label", label); bar.append(b); return b; };
  const series = (data && data.series) || [];
  const groups = series.filter(s => s.g && s.name && document.getElementById(s.g));
  const titles = new Set(groups.map(s => s.group));
  if (titles.size > 1 && titles.size < 9) for (const n of titles) {
    const b = button(n, `${say("Show or hide")} ${n}`, () => {
      const on = b.getAttribute("aria-pressed") === "false"; b.setAttribute("aria-pressed", on);
      for (const s of groups) if (s.group === n) document.getElementById(s.g).style.display = on ? "" : "none";
    });
    b.setAttribute("aria-pressed", "true");
  }
  if (svg.viewBox.baseVal && svg.viewBox.baseVal.width && !(data && data.kind === "turn")) zoom(svg, button);
  button("SVG", `${say("Download as")} SVG: ${name}`, () => save(`${name}.svg`, "image/svg+xml", asFile(svg)));
  button("PNG", `${say("Download as")} PNG: ${name}`, () => {
    const box = new DOMRect(...(svg.dataset.whole || svg.getAttribute("viewBox")).split(/[ ,]+/).map(Number)), k = 3, image = new Image();
    image.onload = () => {
      const c = make("canvas", { width: k * box.width, height: k * box.height }), g = c.getContext("2d");
      g.fillStyle = getComputedStyle(figure).getPropertyValue("--paper"); g.fillRect(0, 0, c.width, c.height); g.drawImage(image, 0, 0, c.width, c.height);
      c.toBlob(b => save(`${name}.png`, "image/png", b));
    };
    image.src = "data:image/svg+xml;charset=utf-8," + encodeURIComponent(asFile(svg));
  });
  if (series.length) button("CSV", `${say("Download as")} CSV: ${name}`, () => {
    const rows = [[say("series"), "x", "y"]];
    for (const s of series) s.x.forEach((x, k) => rows.push([s.name || say("line"), x, s.y[k]]));
    save(`${name}.csv`, "text/csv", rows.map(r => r.map(cell).join(",")).join("\n"));
  });
  figure.append(bar);
  if (!series.length) return;
  const tip = make("div", { className: "tip", hidden: true }); figure.append(tip);
  svg.addEventListener("pointermove", e => {
    const m = svg.getScreenCTM(); if (!m) return;
    const q = new DOMPoint(e.clientX, e.clientY).matrixTransform(m.inverse());
    let best = null, least = 18 ** 2;
    for (const s of series) {
      if (s.g && document.getElementById(s.g)?.style.display === "none") continue;
      s.p.forEach((p, k) => { const d = (p[0] - q.x) ** 2 + (p[1] - q.y) ** 2; if (d < least) { least = d; best = [s, k]; } });
    }
    tip.hidden = !best; if (!best) return;
    const [s, k] = best, [lx, ly] = (data.labels || [])[s.a || 0] || ["x", "y"], f = v => shown(+(+v).toPrecision(4));
    tip.textContent = `${s.name ? s.name + "\n" : ""}${lx || "x"}: ${f(s.x[k])}\n${ly || "y"}: ${f(s.y[k])}`;
    const box = figure.getBoundingClientRect();
    tip.style.left = Math.min(e.clientX - box.left + 14, box.width - tip.offsetWidth - 4) + "px"; tip.style.top = e.clientY - box.top + 14 + "px";
  });
  svg.addEventListener("pointerleave", () => { tip.hidden = true; });
};

// --- tables: sorting, filtering, copying
const value = t => { const s = t.textContent.trim().replace(comma, ".").replace(/−/g, "-").replace(/\u00a0|\s/g, ""); const m = s.match(/^[<+±]?(-?[\d.]+)(?:×10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+))?/); if (!m) return null; const up = m[2] ? [...m[2]].map(c => c === "⁻" ? "-" : "⁰¹²³⁴⁵⁶⁷⁸⁹".indexOf(c)).join("") : "0"; return parseFloat(m[1]) * 10 ** +up; };
for (const table of $$("table")) {
  const head = $$("thead th", table), body = table.tBodies[0], rows = body ? [...body.rows] : [];
  const grouped = rows.some(r => r.cells[0] && !r.cells[0].textContent.trim());
  if (head.length && rows.length > 2 && !grouped) head.forEach((th, k) => {
    const b = make("button", { type: "button" }); b.append(...th.childNodes); th.append(b);
    if (!b.textContent.trim()) b.append(make("span", { className: "visually-hidden", textContent: say("Sort by this column") }));
    b.onclick = () => {
      const up = th.getAttribute("aria-sort") !== "ascending"; head.forEach(h => h.removeAttribute("aria-sort")); th.setAttribute("aria-sort", up ? "ascending" : "descending");
      const key = r => { const v = value(r.cells[k]); return v === null ? r.cells[k].textContent : v; };
      const sorted = [...body.rows].sort((a, c) => { const x = key(a), y = key(c), d = typeof x === "number" && typeof y === "number" ? x - y : String(x).localeCompare(String(y)); return up ? d : -d; });
      body.append(...sorted);
    };
  });
  if (head.length && rows.length > 12) {
    const input = make("input", { className: "filter", type: "search", placeholder: say("Filter rows"), ariaLabel: say("Filter the rows of this table") });
    input.oninput = () => { const q = input.value.toLowerCase(); for (const r of body.rows) r.hidden = !r.textContent.toLowerCase().includes(q); };
    table.parentElement.before(input);
  }
  if (head.length) {
    const b = make("button", { type: "button", textContent: say("Copy table") });
    b.onclick = async () => { const text = [...table.rows].filter(r => !r.hidden).map(r => [...r.cells].map(c => c.textContent.trim()).join("\t")).join("\n"); try { await navigator.clipboard.writeText(text); b.textContent = say("Copied"); } catch { save("table.tsv", "text/tab-separated-values", text); } };
    table.parentElement.after(make("div", { className: "tools" }, b));
  }
}

for (const svg of $$("figure > svg")) {
  const data = dataOf(svg);
  tools(svg.closest("figure"), svg);
  if (data && data.kind === "deformed") hero(svg);
  if (data && data.kind === "turn") turnable(svg);
}
})();
