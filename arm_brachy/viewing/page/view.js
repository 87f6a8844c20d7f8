// The page of `arm-brachy view`: a film with the picture and the curves of the same instant, or
// the live cell, whose shapes come one frame at a time. Needs stage.js.
'use strict';

const INKS = ['#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9', '#22303c'];

class Curves {                     // lines over time, with a mark at the instant that is shown
  constructor(root, plot, span) {   // span : [s, s] of the whole, the same for all curves
    this.plot = plot; this.t = 0; this.span = span;
    const figure = document.createElement('figure');
    figure.innerHTML = '<figcaption></figcaption><canvas></canvas><div class="names"></div>';
    figure.querySelector('figcaption').textContent = plot.title;
    this.canvas = figure.querySelector('canvas'); this.names = figure.querySelector('.names');
    root.append(figure); this.name();
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }
  name() {
    this.names.replaceChildren(...this.plot.lines.map((line, i) => {
      const tag = document.createElement('span');
      tag.style.color = INKS[i % INKS.length]; tag.textContent = line.name; return tag; }));
  }
  draw() {
    const c = this.canvas, ratio = window.devicePixelRatio || 1, ink = c.getContext('2d');
    c.width = c.clientWidth * ratio; c.height = c.clientHeight * ratio;
    const all = this.plot.lines.flatMap(l => l.y).filter(v => v !== null);
    if (!all.length) return;
    const low = Math.min(0, all.reduce((a, b) => Math.min(a, b))), left = 40 * ratio;
    const high = all.reduce((a, b) => Math.max(a, b), low + 1e-9);
    const t0 = this.span[0], t1 = Math.max(this.span[1], t0 + 1e-9), foot = c.height - 16 * ratio;
    const x = t => left + (t - t0) / (t1 - t0) * (c.width - left - 4 * ratio);
    const y = v => foot - (v - low) / (high - low) * (foot - 6 * ratio);
    ink.font = `${11 * ratio}px system-ui, sans-serif`; ink.fillStyle = '#5b6975';
    ink.textAlign = 'right';
    for (const v of [low, high]) ink.fillText(v.toPrecision(2), left - 4 * ratio, y(v) + 4 * ratio);
    ink.textAlign = 'left'; ink.fillText(`${t0.toFixed(0)} s`, left, c.height - 3 * ratio);
    ink.textAlign = 'right'; ink.fillText(`${t1.toFixed(0)} s`, c.width - 4 * ratio, c.height - 3 * ratio);
    ink.strokeStyle = '#dde3e8'; ink.strokeRect(left, 4 * ratio, c.width - left - 4 * ratio, foot - 4 * ratio);
    this.plot.lines.forEach((line, i) => {
      ink.strokeStyle = INKS[i % INKS.length]; ink.lineWidth = 1.3 * ratio; ink.beginPath();
      let drawn = false;
      line.t.forEach((t, k) => {
        if (line.y[k] === null) { drawn = false; return; }
        if (drawn) ink.lineTo(x(t), y(line.y[k])); else ink.moveTo(x(t), y(line.y[k]));
        drawn = true; });
      ink.stroke(); });
    ink.strokeStyle = '#22303c'; ink.lineWidth = ratio; ink.beginPath();
    ink.moveTo(x(this.t), 4 * ratio); ink.lineTo(x(this.t), foot); ink.stroke();
  }
  at(t) { this.t = t; this.draw(); }
}

function picture(image, figure, has) {   // the newest instant asked for; those overtaken are left out
  let busy = false, wanted = null;
  const ask = t => { if (busy) { wanted = t; return; } busy = true; image.src = `/picture?t=${t}`; };
  const over = () => { busy = false; if (wanted !== null) { const t = wanted; wanted = null; ask(t); } };
  image.addEventListener('load', over); image.addEventListener('error', over);
  if (!has) figure.remove();
  return has ? ask : () => {};
}

function openView(data) {
  const times = data.frames.map(frame => frame[0]), aside = document.querySelector('aside');
  const curves = data.plots.map(plot => new Curves(aside, plot, [times[0], times[times.length - 1]]));
  const look = picture(document.querySelector('#picture img'), document.querySelector('#picture'),
                       data.pictures);
  const hear = t => { for (const c of curves) c.at(t); look(t); };
  window.view = playFilm(document.querySelector('.stage'), data, hear);
  return {view: window.view, curves, look};
}

// --- the live cell
const KEPT = 600, DATED = 1e8;           // samples of a curve; s beyond which a time is a date

function openLive(data, token) {
  const root = document.querySelector('.stage'), aside = document.querySelector('aside');
  root.querySelector('.controls').hidden = true;
  const film = data, player = playFilm(root, film), stage = player.stage, curves = {};
  const figure = document.querySelector('#picture'), image = figure.querySelector('img');
  figure.hidden = true;
  let number = 0, busy = false, began = null;
  image.addEventListener('load', () => { busy = false; figure.hidden = false; });
  image.addEventListener('error', () => { busy = false; });
  const take = frame => {
    film.layers = frame.layers; stage.hear(frame.meshes);
    const [stamp, order] = frame.frames[0];
    if (began === null) began = stamp > DATED ? stamp : 0;
    const t = stamp - began;               // dates count from when the page was opened
    stage.show(order.map(k => frame.shapes[k])); stage.list();
    for (const [title, lines] of Object.entries(frame.values)) {
      const curve = curves[title] = curves[title] || new Curves(aside, {title, lines: []}, [t, t]);
      for (const [name, y] of Object.entries(lines)) {
        let line = curve.plot.lines.find(l => l.name === name);
        if (!line) { line = {name, t: [], y: []}; curve.plot.lines.push(line); curve.name(); }
        line.t.push(t); line.y.push(y);
        if (line.t.length > KEPT) { line.t.shift(); line.y.shift(); }
      }
      curve.span = [Math.min(...curve.plot.lines.map(l => l.t[0])), t]; curve.at(t);
    }
    if (!busy) { busy = true; image.src = `/picture?n=${++number}`; }
    document.querySelector('header p').textContent = `t = ${t.toFixed(2)} s`;
  };
  const events = new EventSource('/events');
  let newest = null;                     // a page that is slow leaves frames out, it does not lag
  const draw = () => { const text = newest; newest = null; take(JSON.parse(text)); };
  events.onmessage = event => {
    if (newest === null) requestAnimationFrame(() => setTimeout(draw));
    newest = event.data; };
  window.view = {stage, film, heard: () => number};
  command(token);
}
function command(token) {
  const box = document.querySelector('.command'), say = box.querySelector('.answer');
  const ask = async (path, value) => {
    say.textContent = '…';
    try {
      const answer = await fetch(path, {method: 'POST', body: JSON.stringify(value),
                                        headers: {'X-Arm-Brachy-Token': token}});
      say.textContent = await answer.text();
    } catch { say.textContent = 'the server of this page has ended'; }
  };
  for (const slider of box.querySelectorAll('input.goal')) {
    const label = slider.parentElement.querySelector('output');
    slider.addEventListener('input', () => { label.textContent = slider.value; slider.dataset.used = 1; });
    slider.addEventListener('change', () => {
      const goal = {};
      for (const one of box.querySelectorAll('input.goal'))
        if (one.dataset.used) goal[one.dataset.axis] = +one.value;
      ask('/goal', {target: box.querySelector('select').value, mm: goal});
    });
  }
  box.querySelector('select').addEventListener('change', () => {
    for (const one of box.querySelectorAll('input.goal')) {
      one.value = 0; delete one.dataset.used; one.parentElement.querySelector('output').textContent = '0'; }
  });
  for (const button of box.querySelectorAll('button'))
    button.addEventListener('click', () => ask('/do', {what: button.dataset.do}));
}
