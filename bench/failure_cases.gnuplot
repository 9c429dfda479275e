# gnuplot -e "directory='DIRECTORY'" failure_cases.gnuplot: the CSV files of failure_cases as DIRECTORY/failure_cases.png
set terminal pngcairo size 1900,1100 font "sans,12" noenhanced
set output directory.'/failure_cases.png'
set datafile separator ','
set multiplot layout 4,4 margins 0.055,0.985,0.06,0.9 spacing 0.03,0.035 columnsfirst \
  title "Does backtracking tell that tracking is lost? Four simulated recordings, the paper's rule and thresholds\nblue: converging, not judged yet; red: reported lost, what follows is the same tracker that nobody stopped" font ",15"

# A point in red where the tracker has said `lost` (what follows is a tracker that nobody stopped).
only(column, state) = strcol(2) eq state ? column : NaN

names = "a b c d"
do for [i=1:4] {
  name = word(names, i)
  poses = directory.'/'.name.'_poses.csv'
  verifications = directory.'/'.name.'_verifications.csv'
  line = system("sed -n ".(i + 1)."p '".directory."/cases.csv'")
  # The title is quoted and may hold a comma: the times are counted from the end.
  from_end(k) = system("echo '".line."' | rev | cut -d, -f".k." | rev") + 0.0
  title_of = system("echo '".line."' | cut -d'\"' -f2")
  converged = from_end(3); lost = from_end(2); end = from_end(1)

  set xrange [0:end]
  unset object; unset arrow; unset label
  set object 1 rectangle from first 0, graph 0 to first converged, graph 1 fillcolor rgb "#c8d8f0" fillstyle solid 1 noborder behind
  if (lost < end) {
    set object 2 rectangle from first lost, graph 0 to first end, graph 1 fillcolor rgb "#fbe6e4" fillstyle solid 1 noborder behind
    set arrow 2 from first lost, graph 0 to first lost, graph 1 nohead linecolor rgb "#d62728" linewidth 1.5
  }
  set grid linecolor rgb "#dddddd"
  set key top left samplen 1.5 font ",10"
  set format x ""
  unset xlabel
  set tics font ",10"
  unset ylabel

  # Eq. (13)
  set title "(".name.") ".title_of font ",13" offset 0,-0.6
  set logscale y
  set yrange [0.01:300]
  if (i == 1) { set ylabel "backtracking [px]" }
  plot 5 with lines linecolor rgb "black" dashtype 2 title "threshold 5 px", \
       verifications every ::1 using 1:(only($3, "converging")) with points pointtype 7 pointsize 0.6 linecolor rgb "#1f4e9c" notitle, \
       verifications every ::1 using 1:(only($3, "tracking")) with points pointtype 7 pointsize 0.6 linecolor rgb "#2ca02c" title "tracking", \
       verifications every ::1 using 1:(only($3, "lost")) with points pointtype 7 pointsize 0.6 linecolor rgb "#d62728" title "lost"
  # Eq. (14)
  unset title
  set yrange [0.001:10]
  if (i == 1) { set ylabel "backtracking [rad]" }
  plot 0.15 with lines linecolor rgb "black" dashtype 2 title "threshold 0.15 rad", \
       verifications every ::1 using 1:(only($4, "converging")) with points pointtype 7 pointsize 0.6 linecolor rgb "#1f4e9c" notitle, \
       verifications every ::1 using 1:(only($4, "tracking")) with points pointtype 7 pointsize 0.6 linecolor rgb "#2ca02c" notitle, \
       verifications every ::1 using 1:(only($4, "lost")) with points pointtype 7 pointsize 0.6 linecolor rgb "#d62728" notitle
  # The truth
  set yrange [0.3:1000]
  if (i == 1) { set ylabel "true error [mm], [deg]" }
  plot poses every ::1 using 1:5 with lines linecolor rgb "#444444" linewidth 1.5 title "translation [mm]", \
       poses every ::1 using 1:6 with lines linecolor rgb "#ff7f0e" linewidth 1.5 title "rotation [deg]"
  unset logscale y
  set yrange [0:1400]
  set format x "%g"
  set xlabel "time [s]"
  if (i == 1) { set ylabel "true speed [px/s]" }
  plot poses every ::1 using 1:7 with lines linecolor rgb "#444444" notitle
}
unset multiplot
