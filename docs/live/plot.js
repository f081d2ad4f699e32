// Two graphs over time: an output, and its derivative with respect to the active slider.

const LEFT = 64, RIGHT = 20, GAP = 26, TOP = 18, BOTTOM = 22;

// About four round numbers between two numbers.
function ticks(low, high) {
  const rough = (high - low) / 4, power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5].find((f) => f * power >= rough) ?? 10), found = [];
  for (let k = Math.ceil(low / step); k * step <= high + 1e-9 * step; ++k) found.push(Number((k * step).toPrecision(12)));
  return found;
}

// Draws graphs [{title, curves: [{color, dash, width, at: row => number}]}] of n rows at times t(row), and a cursor at a time.
export function plot(canvas, { n, t, end, now, graphs }) {
  const ratio = devicePixelRatio, w = canvas.clientWidth, h = canvas.clientHeight, c = canvas.getContext('2d');
  canvas.width = w * ratio;
  canvas.height = h * ratio;
  c.scale(ratio, ratio);
  const style = getComputedStyle(canvas), ink = (name) => style.getPropertyValue(name);
  const x = (time) => LEFT + (w - LEFT - RIGHT) * time / end;
  const high = (h - TOP - BOTTOM - GAP * (graphs.length - 1)) / graphs.length;
  c.font = '11px system-ui, sans-serif';
  graphs.forEach(({ title, curves }, g) => {
    const top = TOP + g * (high + GAP);
    let low = Infinity, most = -Infinity;
    for (const { at, ranged = true } of curves) {
      for (let i = 0; ranged && i < n; ++i) if (isFinite(at(i))) { low = Math.min(low, at(i)); most = Math.max(most, at(i)); }
    }
    if (!(low <= most)) [low, most] = [-1, 1];
    const room = 0.06 * (most - low) || Math.abs(most) * 1e-3 || 1;
    low -= room;
    most += room;
    const y = (v) => top + high * (most - v) / (most - low);
    c.fillStyle = ink('--quiet');
    c.strokeStyle = ink('--line');
    c.lineWidth = 1;
    c.textAlign = 'right';
    for (const v of ticks(low, most)) {
      c.fillText(String(v), LEFT - 6, y(v) + 4);
      c.beginPath(); c.moveTo(LEFT, y(v)); c.lineTo(w - RIGHT, y(v)); c.stroke();
    }
    c.textAlign = 'center';
    if (g === graphs.length - 1) for (const v of ticks(0, end)) c.fillText(`${v} s`, x(v), h - 6);
    c.textAlign = 'left';
    c.fillStyle = ink('--ink');
    c.fillText(title, LEFT, top - 5);
    c.save();
    c.beginPath(); c.rect(LEFT, top, w - LEFT - RIGHT, high); c.clip();
    for (const { at, color, dash = [], width = 1.8 } of curves) {
      c.strokeStyle = ink(color);
      c.lineWidth = width;
      c.setLineDash(dash);
      c.beginPath();
      for (let i = 0, pen = false; i < n; ++i) {
        const v = at(i);
        if (isFinite(v)) pen ? c.lineTo(x(t(i)), y(v)) : c.moveTo(x(t(i)), y(v));
        pen = isFinite(v);
      }
      c.stroke();
    }
    c.restore();
    c.setLineDash([]);
    c.strokeStyle = ink('--quiet');
    c.beginPath(); c.moveTo(x(now), top); c.lineTo(x(now), top + high); c.stroke();
  });
}

// The time at a place of the pointer.
export function timeAt(canvas, event, end) {
  const { left, width } = canvas.getBoundingClientRect();
  return Math.min(Math.max((event.clientX - left - LEFT) / (width - LEFT - RIGHT), 0), 1) * end;
}
