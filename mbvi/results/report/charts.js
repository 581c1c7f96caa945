"use strict";
// draws the plots of a report as SVG; one view and one cursor in time for all of them
const SVG = "http://www.w3.org/2000/svg";
const MARGIN = {left: 62, right: 12, top: 8, bottom: 34};
const HEIGHT = 210;
const data = JSON.parse(document.getElementById("plots").textContent);
const charts = [];
let view = [data.start, data.end];

function element(parent, tag, attributes, text) {
    const made = document.createElementNS(SVG, tag);
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    if (text !== undefined) made.textContent = text;
    parent.appendChild(made);
    return made;
}

function html(parent, tag, className, text) {
    const made = document.createElement(tag);
    made.className = className;
    if (text !== undefined) made.textContent = text;
    parent.appendChild(made);
    return made;
}

function written(value, step) {
    if (value === 0) return "0";
    const size = Math.abs(value);
    if (size >= 1e5 || size < 1e-3) return value.toExponential(step ? undefined : 2).replace("e+", "e");
    if (step) return value.toFixed(Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));
    return String(Number(value.toPrecision(4)));
}

// ticks at 1, 2 or 5 times a power of ten
function ticks(low, high, most, least) {
    const raw = (high - low) / most, power = 10 ** Math.floor(Math.log10(raw));
    const step = Math.max([1, 2, 5, 10].find(n => n * power >= raw * (1 - 1e-9)) * power, least);
    const found = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(Number((k * step).toPrecision(12)));
    return {found, step};
}

// the first index whose time is greater
function after(times, t) {
    let low = 0, high = times.length;
    while (low < high) {
        const middle = (low + high) >> 1;
        if (times[middle] > t) high = middle; else low = middle + 1;
    }
    return low;
}

class Chart {
    constructor(panel, parent) {
        this.panel = panel;
        this.figure = html(parent, "figure", "chart");
        const head = html(this.figure, "figcaption", "head");
        html(head, "strong", "", panel.title);
        html(head, "span", "note", panel.note).title = panel.note;
        const legend = html(this.figure, "div", "legend");
        for (const curve of panel.curves) {
            if (!curve.name) continue;
            const entry = html(legend, "span", "entry", curve.name);
            html(entry, "i", curve.style).style.background = curve.color;
        }
        this.svg = element(this.figure, "svg", {height: HEIGHT, role: "img", "aria-label": panel.title});
        this.tip = html(this.figure, "div", "tip");
        this.svg.addEventListener("pointermove", event => moved(this, event));
        this.svg.addEventListener("pointerdown", event => pressed(this, event));
        this.svg.addEventListener("pointerup", event => released(this, event));
        this.svg.addEventListener("pointerleave", () => setCursor(null));
        this.svg.addEventListener("dblclick", () => setView(data.start, data.end));
    }

    range() {
        const {panel} = this;
        let low = Infinity, high = -Infinity;
        for (const curve of panel.curves) {
            if (curve.style === "ticks") continue;
            const first = Math.max(after(curve.t, view[0]) - 1, 0);
            const last = Math.min(after(curve.t, view[1]) + 1, curve.t.length);
            for (let k = first; k < last; k++) {
                const y = curve.y[k];
                if (y === null || (panel.log && y <= 0)) continue;
                low = Math.min(low, y);
                high = Math.max(high, y);
            }
        }
        for (const level of panel.levels) {
            low = Math.min(low, level.y);
            high = Math.max(high, level.y);
        }
        if (panel.log) {
            if (!(high > 0)) return [1e-3, 1];
            return [0.6 * Math.max(low, 1e-8 * high), 1.7 * high];
        }
        if (!(high >= low)) return [0, 1];
        if (high === low) [low, high] = low > 0 ? [0, 1.1 * high] : low < 0 ? [1.1 * low, 0] : [0, 1];
        const pad = 0.05 * (high - low);
        return [low >= 0 && low < 0.7 * high ? 0 : low - pad, high + pad];
    }

    draw() {
        const {svg, panel} = this;
        this.width = svg.clientWidth || 500;
        svg.setAttribute("viewBox", `0 0 ${this.width} ${HEIGHT}`);
        svg.replaceChildren();
        const right = this.width - MARGIN.right, bottom = HEIGHT - MARGIN.bottom;
        const [low, high] = this.range();
        const place = panel.log ? Math.log10 : y => y;
        const scale = (bottom - MARGIN.top) / (place(high) - place(low));
        this.x = t => MARGIN.left + (right - MARGIN.left) * (t - view[0]) / (view[1] - view[0]);
        this.y = y => bottom - scale * (place(panel.log ? Math.max(y, 1e-3 * low) : y) - place(low));
        this.grid(low, high, right, bottom);
        const clip = `clip${charts.indexOf(this)}`;
        element(element(svg, "clipPath", {id: clip}), "rect", {
            x: MARGIN.left - 1, y: MARGIN.top - 3, width: right - MARGIN.left + 4, height: bottom - MARGIN.top + 3});
        const inside = element(svg, "g", {"clip-path": `url(#${clip})`});
        for (const level of panel.levels) {
            const y = this.y(level.y);
            element(inside, "line", {x1: MARGIN.left, x2: right, y1: y, y2: y, class: level.label ? "level" : "zero"});
            if (level.label) element(inside, "text", {x: right - 4, y: y < MARGIN.top + 12 ? y + 11 : y - 3, "text-anchor": "end", class: "label"}, level.label);
        }
        for (const curve of panel.curves) this.curve(inside, curve, bottom);
        this.playing = element(svg, "line", {y1: MARGIN.top, y2: bottom, class: "playing"});
        this.cursor = element(svg, "line", {y1: MARGIN.top, y2: bottom, class: "cursor", visibility: "hidden"});
        this.chosen = element(svg, "rect", {y: MARGIN.top, height: bottom - MARGIN.top, width: 0, class: "chosen"});
        place_line(this, this.playing, playing);
    }

    grid(low, high, right, bottom) {
        const {svg, panel} = this;
        const line = (y, text) => {
            const at = this.y(y);
            element(svg, "line", {x1: MARGIN.left, x2: right, y1: at, y2: at, class: "grid"});
            if (text) element(svg, "text", {x: MARGIN.left - 6, y: at + 3.5, "text-anchor": "end"}, text);
        };
        if (panel.log) {
            const first = Math.ceil(Math.log10(low)), last = Math.floor(Math.log10(high));
            const every = Math.max(1, Math.ceil((last - first + 1) / 6));
            if (last - first >= 1) {
                for (let k = last; k >= first; k -= every) line(10 ** k, `1e${k}`);
            } else {
                for (let k = first - 1; k <= last + 1; k++) for (const n of [1, 2, 5]) {
                    const y = Number(`${n}e${k}`);
                    if (y >= low && y <= high) line(y, written(y));
                }
            }
        } else {
            const {found, step} = ticks(low, high, 6.5, panel.whole ? 1 : 0);
            for (const y of found) line(y, written(y, step));
        }
        const {found, step} = ticks(...view, Math.max(3, Math.min(9, this.width / 65)), 0);
        for (const t of found) {
            const at = this.x(t);
            element(svg, "line", {x1: at, x2: at, y1: MARGIN.top, y2: bottom, class: "grid"});
            element(svg, "text", {x: at, y: bottom + 14, "text-anchor": "middle"}, written(t, step));
        }
        element(svg, "path", {d: `M${MARGIN.left},${MARGIN.top}V${bottom}H${right}`, class: "axis"});
        element(svg, "text", {x: (MARGIN.left + right) / 2, y: HEIGHT - 5, "text-anchor": "middle", class: "label"}, "time [s]");
        const middle = (MARGIN.top + bottom) / 2;
        element(svg, "text", {
            x: 11, y: middle, "text-anchor": "middle", transform: `rotate(-90 11 ${middle})`, class: "label"}, panel.axis);
    }

    curve(parent, curve, bottom) {
        const first = Math.max(after(curve.t, view[0]) - 2, 0), last = Math.min(after(curve.t, view[1]) + 2, curve.t.length);
        let path = "", pen = false;
        const radius = last - first < 300 ? 2.4 : last - first < 3000 ? 1.5 : 0.9;
        for (let k = first; k < last; k++) {
            const value = curve.y[k], x = this.x(curve.t[k]).toFixed(1);
            if (curve.style === "ticks") { path += `M${x},${bottom}v-9`; continue; }
            if (value === null) { pen = false; continue; }
            const y = this.y(value).toFixed(1);
            if (curve.style === "dots") {
                if (!this.panel.log || value > 0) path += `M${x},${y}m-${radius},0a${radius},${radius} 0 1,0 ${2 * radius},0a${radius},${radius} 0 1,0 -${2 * radius},0`;
            } else if (!pen) {
                path += `M${x},${y}`;
                // a value alone would not be seen
                if (curve.y[k + 1] === null || k + 1 === curve.t.length) path += "h1.5";
            } else path += curve.style === "steps" ? `V${y}H${x}` : `L${x},${y}`;
            pen = true;
        }
        const dots = curve.style === "dots", many = curve.style === "ticks" && last - first > 100;
        element(parent, "path", {
            d: path, fill: dots ? curve.color : "none", stroke: dots ? "none" : curve.color,
            "stroke-width": 1.3, "stroke-linejoin": "round", opacity: many ? 0.35 : dots ? 0.8 : 1});
    }

    // the values at a time, on the side of the plot where the cursor is not
    read(t) {
        const {panel, tip} = this, near = 0.01 * (view[1] - view[0]);
        tip.replaceChildren();
        tip.hidden = t === null;
        if (t === null) return;
        html(tip, "div", "", `${written(t)} s`);
        for (const curve of panel.curves) {
            if (!curve.t.length || curve.style === "ticks") continue;
            let i = after(curve.t, t);
            if (curve.style === "steps") i = Math.min(i, curve.t.length - 1);
            else if (i === curve.t.length || (i > 0 && t - curve.t[i - 1] < curve.t[i] - t)) i--;
            if (curve.y[i] === null || (curve.style === "dots" && Math.abs(curve.t[i] - t) > near)) continue;
            html(tip, "div", "", written(curve.y[i])).style.color = curve.color;
        }
        const left = t > (view[0] + view[1]) / 2;
        tip.style.left = left ? `${MARGIN.left + 4}px` : "";
        tip.style.right = left ? "" : `${MARGIN.right + 4}px`;
    }
}

function place_line(chart, line, t) {
    const seen = t !== null && t >= view[0] && t <= view[1];
    line.setAttribute("visibility", seen ? "visible" : "hidden");
    if (!seen) return;
    line.setAttribute("x1", chart.x(t));
    line.setAttribute("x2", chart.x(t));
}

function setCursor(t) {
    for (const chart of charts) {
        place_line(chart, chart.cursor, t);
        chart.read(t);
    }
}

function setView(start, end) {
    view = [start, end];
    for (const chart of charts) chart.draw();
}

// a drag chooses a part of the time, a click shows its instant in the replay
let drag = null;
function time_of(chart, event) {
    const box = chart.svg.getBoundingClientRect(), x = event.clientX - box.left;
    const part = (x - MARGIN.left) / (chart.width - MARGIN.left - MARGIN.right);
    return view[0] + Math.min(Math.max(part, 0), 1) * (view[1] - view[0]);
}
function pressed(chart, event) {
    drag = {chart, t: time_of(chart, event), x: event.clientX};
    chart.svg.setPointerCapture(event.pointerId);
}
function moved(chart, event) {
    const t = time_of(chart, event);
    setCursor(t);
    if (drag && drag.chart === chart) {
        const [a, b] = [chart.x(drag.t), chart.x(t)].sort((p, q) => p - q);
        chart.chosen.setAttribute("x", a);
        chart.chosen.setAttribute("width", Math.abs(event.clientX - drag.x) > 4 ? b - a : 0);
    }
}
function released(chart, event) {
    if (!drag || drag.chart !== chart) return;
    const [a, b] = [drag.t, time_of(chart, event)].sort((p, q) => p - q);
    const far = Math.abs(event.clientX - drag.x) > 4;
    drag = null;
    if (far && b > a) setView(a, b);
    else { chart.chosen.setAttribute("width", 0); seek(a); }
}

// the replay is a page of its own; its slider holds the seconds since the start of the run
const frame = document.getElementById("replay");
let playing = null;
function slider() {
    const page = frame && frame.contentDocument;
    return page && (page.getElementById("time") || page.querySelector("input[type=range]"));
}
function seek(t) {
    const found = slider();
    if (!found) return;
    found.value = t - data.start;
    found.dispatchEvent(new Event("input", {bubbles: true}));
    found.dispatchEvent(new Event("change", {bubbles: true}));
}
function follow() {
    const found = slider(), t = found ? data.start + Number(found.value) : null;
    if (t !== playing) {
        playing = t;
        for (const chart of charts) place_line(chart, chart.playing, t);
    }
    requestAnimationFrame(follow);
}

for (const panel of data.panels) charts.push(new Chart(panel, document.getElementById("charts")));
setView(data.start, data.end);
new ResizeObserver(() => setView(...view)).observe(document.getElementById("charts"));
for (const row of document.querySelectorAll("tr[data-time]")) {
    row.addEventListener("click", () => { setCursor(Number(row.dataset.time)); seek(Number(row.dataset.time)); });
}
if (frame) follow();
